"""What `echogrid view` costs, and whom it delays: `python -m tests.bench.viewers`, on the loopback, with maps of noise at 20 Hz.

python -m tests.bench.viewers listen ENDPOINT SECONDS   is another subscriber: it prints how old each map is when it comes (s)
python -m tests.bench.viewers look PORT COUNT SECONDS   are COUNT viewers: they print how many maps each was told
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import zenoh

from echogrid.config.loading import load_config
from echogrid.config.tables import Publish, Ros
from echogrid.logs.drive import find_drive
from echogrid.viewing.wire import Kind
from echogrid.zenoh.attachment import decode_grid_attachment
from echogrid.zenoh.publisher import Publisher, session_config
from tests.bench.subscribers import Car, drive_for, endpoint, told
from tests.support.pages import watch
from tests.support.places import DEMO
from tests.support.ports import free_port

SECONDS, VIEWERS, ROUNDS = 15.0, 10, 2


def main() -> None:
    config = msgspec.structs.replace(load_config(find_drive(DEMO, None).config, "analytic"), vehicle="car")
    address, port = endpoint(), free_port()
    with Publisher(Publish(listen=(address,)), "car", Ros()) as publisher:
        car = Car(config, 256, publisher)
        view = start("-m", "echogrid", "view", "--endpoint", address, "--vehicle", "car", "--listen", str(port))
        drive_for(car, 4.0)
        for viewers in (0, VIEWERS) * ROUNDS:
            looking = start("-m", "tests.bench.viewers", "look", str(port), str(viewers), str(SECONDS))
            listening = start("-m", "tests.bench.viewers", "listen", address, str(SECONDS - 3))
            drive_for(car, 3.0)
            busy = cpu_s(view.pid)
            began = time.monotonic()
            drive_for(car, SECONDS - 6)
            share = (cpu_s(view.pid) - busy) / (time.monotonic() - began)
            told(f"{viewers} viewers: age of a map at another subscriber", json.loads(listening.communicate(timeout=60)[0]))
            maps = looking.communicate()[0].strip()
            print(f"  echogrid view takes {share:.1%} of a core, {resident_mib(view.pid):.0f} MiB; maps told: {maps}")
        view.send_signal(signal.SIGINT)
        view.wait(30)


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True)


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mib(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


def listen(address: str, seconds: float) -> None:
    ages, until = [], time.monotonic() + seconds
    with zenoh.open(session_config((), (address,), sends=False)) as session:
        subscriber = session.declare_subscriber("echogrid/v1/car/grid/fused/full")
        while time.monotonic() < until:
            sample = subscriber.try_recv()
            if sample is None:
                time.sleep(0.0005)
                continue
            ages.append((time.time_ns() - decode_grid_attachment(bytes(sample.attachment))[1]) * 1e-9)
    print(json.dumps(ages))


def look(port: int, count: int, seconds: float) -> None:
    until, maps = time.monotonic() + seconds, np.zeros(count, dtype=int)

    def one(number: int) -> None:
        with watch(port) as viewer:
            while time.monotonic() < until:
                with contextlib.suppress(TimeoutError):
                    maps[number] += viewer.recv(timeout=0.5)[0] == Kind.POSE

    threads = [threading.Thread(target=one, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(f"{maps.min()} to {maps.max()} each in {seconds:.0f} s" if count else "nobody looks")


if __name__ == "__main__":
    if sys.argv[1:2] == ["listen"]:
        listen(sys.argv[2], float(sys.argv[3]))
    elif sys.argv[1:2] == ["look"]:
        look(int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
    else:
        main()
