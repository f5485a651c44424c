"""From the last frame that a map is made of, as it is sent on a virtual bus, to a subscriber in another process.

`python -m tests.bench.latency [SECONDS]` prints one line of JSON; `... watch ENDPOINT VEHICLE` is the subscriber, which at the end of its
input prints of each map its stamp and when it came.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import threading
import time

import msgspec
import zenoh

from echogrid.can.signals import bus_of
from echogrid.config.loading import load_config
from echogrid.core.mapper import MapUpdate
from echogrid.live.player import on_virtual_buses, senders
from echogrid.live.process import begin, settle
from echogrid.live.service import Service
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.model.network import OnnxSensorModel
from echogrid.pipeline import Pipeline
from echogrid.zenoh.publisher import session_config
from tests.bench.live import DEMO, in_real_time
from tests.support.ports import free_port

WARM = 5.0  # s that are not counted: the network's files are timed against each other, and no cache is filled


def watch(endpoint: str, vehicle: str) -> None:
    """Stamp in ns and time.monotonic() of each whole window."""
    came: list[tuple[int, float]] = []

    def take(sample: zenoh.Sample) -> None:
        at, head = time.monotonic(), bytes(sample.payload)[4:12]  # behind CDR's own four bytes
        came.append((int.from_bytes(head[:4], "little") * 10**9 + int.from_bytes(head[4:], "little"), at))

    with zenoh.open(session_config((), (endpoint,), sends=False)) as session:
        subscriber = session.declare_subscriber(f"echogrid/v1/{vehicle}/grid/fused/full", take)
        sys.stdin.read()
        subscriber.undeclare()
    print(json.dumps(came), flush=True)


def latency(seconds: float) -> dict[str, float]:
    """ms, of the demo drive's first seconds with its own configuration, but for WARM; beside an inference in the same run."""
    begin()  # as `echogrid run` does
    drive = find_drive(DEMO, None)
    config = on_virtual_buses(load_config(drive.config, None))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = msgspec.structs.replace(config, publish=msgspec.structs.replace(config.publish, listen=(endpoint,)))
    pipeline = Pipeline(config, drive.config)
    service = Service(pipeline)
    last_ns, sent, inferences = dict[int, int](), dict[int, float](), list[float]()
    end_cycle, infer = pipeline.mapper.end_cycle, pipeline.model.infer

    def noted() -> MapUpdate | None:
        newest_ns = max((scan.received_ns for scan in pipeline.mapper.pending), default=0)
        update = end_cycle()
        if update is not None:
            last_ns[update.ego.stamp_ns] = newest_ns
        return update

    pipeline.mapper.end_cycle = noted  # type: ignore[method-assign]
    if isinstance(infer, OnnxSensorModel):
        run = infer._output

        def timed(image: object) -> object:
            begun = time.perf_counter()
            answer = run(image)  # type: ignore[arg-type]
            inferences.append(time.perf_counter() - begun)
            return answer

        infer._output = timed  # type: ignore[method-assign, assignment]
    command = [sys.executable, "-m", "tests.bench.latency", "watch", endpoint, config.vehicle]
    subscriber = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def play() -> None:
        try:
            service.live.wait(30.0)
            time.sleep(3.0)  # until the subscriber is there
            buses = senders(config)
            for message in in_real_time(service, Log(drive.log), seconds):
                sent[round(message.timestamp * 1e6)] = time.monotonic()
                buses[str(bus_of(message, config.bus))].send(message)
            time.sleep(0.5)
            for opened in buses.values():
                opened.shutdown()
        finally:
            service.workers.stop.set()

    player = threading.Thread(target=play)
    settle()
    player.start()
    service.run()
    player.join()
    came = json.loads(subscriber.communicate()[0])
    matched = [(sent[last_ns[stamp_ns] // 1000], at) for stamp_ns, at in came if last_ns.get(stamp_ns, 0) // 1000 in sent]
    delays = sorted(at - sent_at for sent_at, at in matched if sent_at - matched[0][0] > WARM)
    inference = statistics.median(inferences)
    p50, p99 = statistics.median(delays), delays[int(0.99 * (len(delays) - 1))]
    return {
        "maps": len(delays),
        "p50_ms": p50 * 1e3,
        "p99_ms": p99 * 1e3,
        "inference_p50_ms": inference * 1e3,
        "p50_by_inference": p50 / inference,
        "p99_by_inference": p99 / inference,
    }


if __name__ == "__main__":
    if sys.argv[1:2] == ["watch"]:
        watch(*sys.argv[2:4])
    else:
        print(json.dumps(latency(float(sys.argv[1]) if len(sys.argv) > 1 else 30.0)))
