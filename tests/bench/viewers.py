"""What `echogrid view` costs, and whom it delays: `python -m tests.bench.viewers [ROUNDS]`, on the loopback, with maps of noise at 20 Hz.

Stretches without viewers and with ten take turns, and at the end a page in a headless Chromium, where one is at hand, shows the same.

python -m tests.bench.viewers listen ENDPOINT   is another subscriber: at its end it prints when each map came and how old it was (ns)
python -m tests.bench.viewers look PORT COUNT   are COUNT viewers: they say when all are there, and at the end how many maps each was told
python -m tests.bench.viewers page PORT SECONDS is a page: it says when it shows the map, and at the end its pictures and maps a second
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
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

SECONDS, VIEWERS, ROUNDS = 20.0, 10, 6
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@dataclass
class Stretch:
    """What was measured from `begin` to `end` (ns since 1970): shares of a core."""

    begin: int
    end: int
    view: float
    publisher: float
    load: float


def main(rounds: int) -> None:
    config = msgspec.structs.replace(load_config(find_drive(DEMO, None).config, "analytic"), vehicle="car")
    address, port = endpoint(), free_port()
    with Publisher(Publish(listen=(address,)), "car", Ros()) as publisher:
        car = Car(config, 256, publisher)
        view = start("-m", "echogrid", "view", "--endpoint", address, "--vehicle", "car", "--listen", str(port))
        listener = start("-m", "tests.bench.viewers", "listen", address)
        drive_until_said(car, view)
        drive_until_said(car, listener)
        measured: dict[int, list[Stretch]] = {0: [], VIEWERS: []}
        for viewers in (0, VIEWERS) * rounds:
            looking = start("-m", "tests.bench.viewers", "look", str(port), str(viewers))
            drive_until_said(car, looking)
            measured[viewers].append(stretch(car, view))
            print(f"{viewers} viewers, {resident_mib(view.pid):.0f} MiB; maps told: {looking.communicate()[0].strip()}", flush=True)
        maps = np.array(json.loads(listener.communicate()[0]))
        p99 = {}
        for viewers, stretches in measured.items():
            ages = [[age * 1e-9 for came, age in maps if one.begin < came < one.end] for one in stretches]
            told(f"{viewers} viewers: age of a map at another subscriber", [age for some in ages for age in some])
            each = [float(np.percentile(some, 99)) * 1e3 for some in ages]
            p99[viewers] = float(np.percentile([age for some in ages for age in some], 99))
            print(f"  p99 by stretch: {', '.join(f'{one:.1f}' for one in each)} ms; load {', '.join(f'{s.load:.1f}' for s in stretches)}")
            print(f"  of a core: view {shares([s.view for s in stretches])}, publishing {shares([s.publisher for s in stretches])}")
        print(f"p99 with viewers / without: {p99[VIEWERS] / p99[0]:.2f}")
        if CHROMIUM is not None:
            page = start("-m", "tests.bench.viewers", "page", str(port), str(SECONDS - 5))
            drive_until_said(car, page)
            one = stretch(car, view)
            print(f"one page: {page.communicate()[0].strip()}; of a core: view {one.view:.1%}, publishing {one.publisher:.1%}")
        view.send_signal(signal.SIGINT)
        view.wait(30)


def stretch(car: Car, view: subprocess.Popen[str]) -> Stretch:
    busy, own, began, begin = cpu_s(view.pid), time.process_time(), time.monotonic(), time.time_ns()
    drive_for(car, SECONDS)
    took = time.monotonic() - began
    return Stretch(begin, time.time_ns(), (cpu_s(view.pid) - busy) / took, (time.process_time() - own) / took, os.getloadavg()[0])


def shares(found: list[float]) -> str:
    return f"{min(found):.1%} to {max(found):.1%}"


def start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def drive_until_said(car: Car, program: subprocess.Popen[str]) -> None:
    """Until its first line."""
    assert program.stdout is not None
    said = threading.Thread(target=program.stdout.readline)
    said.start()
    while said.is_alive():
        drive_for(car, 0.2)
    drive_for(car, 1.0)


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mib(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


def ready() -> threading.Event:
    """Says that it is; the event is set when the input ends."""
    print("ready", flush=True)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    return ended


def listen(address: str) -> None:
    maps = []
    with zenoh.open(session_config((), (address,), sends=False)) as session:
        subscriber = session.declare_subscriber("echogrid/v1/car/grid/fused/full")
        ended = ready()
        while not ended.is_set():
            sample = subscriber.try_recv()
            if sample is None:
                time.sleep(0.0005)
                continue
            now = time.time_ns()
            maps.append((now, now - decode_grid_attachment(bytes(sample.attachment))[1]))
    print(json.dumps(maps))


def look(port: int, count: int) -> None:
    maps, there = np.zeros(count, dtype=int), threading.Barrier(count + 1)
    ended = threading.Event()

    def one(number: int) -> None:
        with watch(port) as viewer:
            there.wait()
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    maps[number] += viewer.recv(timeout=0.5)[0] == Kind.POSE

    threads = [threading.Thread(target=one, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    there.wait()
    began = time.monotonic()
    ready().wait()
    ended.set()
    for thread in threads:
        thread.join()
    print(f"{maps.min()} to {maps.max()} each in {time.monotonic() - began:.0f} s" if count else "nobody looks")


def page(port: int, seconds: float) -> None:
    from playwright.sync_api import sync_playwright

    count = """(seconds) => new Promise((done) => {
        const [e, began] = [window.echogrid, performance.now()], [drawn, stamps] = [e.drawn, new Set()];
        let frames = 0;
        const step = () => {
            frames++;
            stamps.add(e.pose.stamp);
            const took = (performance.now() - began) / 1000;
            if (took < seconds) return requestAnimationFrame(step);
            done([frames, e.drawn - drawn, stamps.size].map((found) => found / took));
        };
        requestAnimationFrame(step);
    })"""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1280, "height": 800})
        tab.goto(f"http://127.0.0.1:{port}/")
        while not tab.evaluate("!!window.echogrid?.pose"):
            time.sleep(0.1)
        print("ready", flush=True)
        frames, drawn, maps = tab.evaluate(count, seconds)
        print(f"{frames:.1f} animation frames, {drawn:.1f} pictures and {maps:.1f} maps a second")
        browser.close()


if __name__ == "__main__":
    if sys.argv[1:2] == ["listen"]:
        listen(sys.argv[2])
    elif sys.argv[1:2] == ["look"]:
        look(int(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1:2] == ["page"]:
        page(int(sys.argv[2]), float(sys.argv[3]))
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS)
