"""The running service on real CAN interfaces, fed at the buses' pace by another process: its share of a core.

`python -m tests.bench.socketcan [SECONDS [MODEL]]`, as root; MODEL as in a configuration, the default network if none is given. Where
this machine has no vcan, it runs itself in the rig's guest, and says too what the guest as a whole took of this machine's time with the
service, less what it took for the sender alone: the guest's own clock counts whole ticks, by chance. Prints one line of JSON.
"""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from bisect import bisect
from contextlib import suppress
from os import getpid
from pathlib import Path

from echogrid.client import Client
from tests.rig import guest, real_bus
from tests.rig.test_can import running

CPUCLOCK_SCHED = 2  # linux/posix-timers.h
SAMPLES = 0.1  # s from one look at the guest's processor time to the next


def spent(process: int) -> float:
    """s that another process ran, as the scheduler measured it. /proc counts ticks: who wakes with them is charged more than it took, in
    the rig's guest a third more (a loop that is busy for a fifth of the time: 0.26 by ticks, 0.195 by this)."""
    return time.clock_gettime((~process << 3) | CPUCLOCK_SCHED)


def share(seconds: float, model: str) -> dict[str, object]:
    """Of `seconds` of the demo drive, radars and motion on buses of their own. `alone`, `with_service`: when it was played."""
    messages = real_bus.drive(seconds)
    with real_bus.senders() as buses:
        alone = time.time()
        real_bus.play(messages, buses)
    with tempfile.TemporaryDirectory() as folder, running(Path(folder), one_bus=False, model=model) as service, real_bus.senders() as buses:
        service.client.close()  # whose threads are none of the service's
        before, begun = spent(service.process.pid), time.time()
        real_bus.play(messages, buses)
        wall, took = time.time() - begun, spent(service.process.pid) - before
        read = len(service.read(messages))
        with Client(service.endpoint, real_bus.VEHICLE) as service.client:
            status = service.status_when(lambda status: status["frames"] >= read)
            service.stop()
    return {
        "share_of_a_core": round(took / wall, 3),
        "late_s": round(wall - seconds, 2),
        "cycles": status["cycles"],
        "latency_ms": status["latency_ms"],
        "rss_mib": round(status["rss_mib"]),
        "overflow": [bus["overflow"] for bus in status["buses"].values()],
        "alone": (alone, alone + seconds),
        "with_service": (begun, begun + seconds),
    }


def in_guest(seconds: float, model: str) -> dict[str, object]:
    """The same in the rig's guest, with `share_by_host`."""
    times, took, ended = list[float](), list[float](), threading.Event()

    def sample() -> None:
        while not ended.wait(SAMPLES):
            times.append(time.time())
            took.append(by_children())

    sampler = threading.Thread(target=sample)
    sampler.start()
    answer = guest.run([sys.executable, "-m", "tests.bench.socketcan", str(seconds), model])
    ended.set()
    sampler.join()
    if answer.status != 0:
        sys.exit(f"tests.bench.socketcan: {answer.output}")
    found: dict[str, object] = json.loads(answer.output.splitlines()[-1])

    def rate(phase: object) -> float:
        assert isinstance(phase, list)
        first, last = (bisect(times, at) for at in phase)
        return (took[last] - took[first]) / (times[last] - times[first])

    found["share_by_host"] = round(rate(found.pop("with_service")) - rate(found.pop("alone")), 3)
    return found


def by_children() -> float:
    """s that sessions begun by this process have run: the guest's kernel and its processes, each of which is one here too."""
    total = 0
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended meanwhile
            session = stat(process)[3]
            if session != "0" and stat(Path("/proc", session))[1] == str(getpid()):
                total += sum(int((task / "schedstat").read_text().split()[0]) for task in process.glob("task/*"))
    return total * 1e-9


def stat(process: Path) -> list[str]:
    """The fields of /proc/PID/stat behind the name: state, parent, group, session."""
    return (process / "stat").read_text().rpartition(")")[2].split()


if __name__ == "__main__":
    length, which = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0, sys.argv[2] if len(sys.argv) > 2 else "default"
    try:
        with real_bus.interfaces():
            print(json.dumps(share(length, which)))
    except real_bus.NoInterfacesError as why:
        if lack := guest.missing():
            sys.exit(f"tests.bench.socketcan: {why}; {lack}")
        print(json.dumps(in_guest(length, which)))
