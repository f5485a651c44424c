"""kill -9 at random instants while a process maps and flushes: what the file then holds, against the same map made again.

The child says when it made each update, and after each flush how many were in the map when that began. Those must be in the file, where
every tile must be, bit for bit, as it was after one of the updates; and the next child goes on with the same file.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.config.tables import Store
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.core.map.tiled_map import View
from echogrid.core.motion.se2 import SE2
from echogrid.store.store_file import StoreError
from echogrid.store.stored_map import describe
from echogrid.store.tile_keeper import TileKeeper
from echogrid.store.tile_store import TileStore
from tests.support.places import ROOT

SPEC = GridSpec(cells=32, cell=0.25)
ROOM = 6  # tiles in memory, of 30 that the car visits
FLUSH_S = 0.1  # the shortest that a configuration may say
LONGEST_S = 1.0  # that a child lives


class Car:
    """A map of random updates, each within one tile and one second after the last, the same each time."""

    def __init__(self, max_tiles: int) -> None:
        self.map = LookMap(SPEC, Calibration(), max_tiles=max_tiles)
        self.rng = np.random.default_rng(0)
        self.updates = 0

    def update(self) -> TileKey:
        """The tile that it changed."""
        self.updates += 1
        row, column = self.rng.integers(0, (5, 6)).tolist()
        side = SIDE * SPEC.cell
        said = self.rng.uniform(0.1, 1, (2, 32, 32)).astype(np.float32)
        view = View(self.updates * 10**9, np.ones((32, 32), np.uint16))
        self.map.integrate(said, SE2((column + 0.5) * side, (row + 0.5) * side, 0.3), view)
        return row, column


@dataclass(frozen=True, slots=True)
class Killed:
    """One child's end."""

    said: int | None = None  # updates that it said were on disk; None where it was killed before its first word
    updates: int = 0  # the newest one in the file
    lost_s: float = 0.0  # before its end, the oldest update that is not


def child(path: Path) -> None:
    """Maps and flushes until it is killed."""
    car = Car(ROOM)
    lock = threading.Lock()
    kept = _Telling(path, Store(flush_s=FLUSH_S), car.map, describe(car.map, "car", ("front",), 0), lock)
    kept.car = car
    car.map.shelf = kept
    threading.Thread(target=kept.run, args=(threading.Event(),)).start()
    while True:
        with lock:
            car.update()
        os.write(1, f"update {car.updates} {time.monotonic()}\n".encode())
        time.sleep(0.001)


class _Telling(TileKeeper):
    """Says after each flush how much was mapped when it began."""

    car: Car | None = None

    def flush(self) -> None:
        with self.lock:
            updates = 0 if self.car is None else self.car.updates
        super().flush()
        os.write(1, f"flush {updates} {self.epoch} {self.status.state} {self.status.forgotten}\n".encode())


def kill(path: Path, after_s: float) -> Killed:
    """Starts a child on the file, kills it, and looks at what it left. Raises AssertionError where that is not what it said."""
    before = _epochs(path)
    command = [sys.executable, "-m", "tests.endurance.kill", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline() if after_s > 0 else ""  # a life is counted from its first word on, but for some
        time.sleep(abs(after_s))
        process.send_signal(signal.SIGKILL)
        killed_at = time.monotonic()
        words = [line.split() for line in (first, *process.stdout) if line]
    after = _epochs(path)
    assert set(before) <= set(after) | {epoch for epoch, tiles in before.items() if not tiles}, "an older map is gone"
    for epoch, tiles in before.items():
        assert not tiles or after[epoch] == tiles, "an older map has changed"
    flushes = [(int(updates), int(epoch), *state) for kind, updates, epoch, *state in words if kind == "flush"]
    if not flushes:
        return Killed()
    assert {tuple(state) for _, _, *state in flushes} == {("ok", "0")}, flushes
    said, epoch, *_ = flushes[-1]
    newest = _checked(path, epoch, said)
    lost = [float(made_at) for kind, update, made_at, *_ in words if kind == "update" and int(update) > newest]
    return Killed(said, newest, killed_at - lost[0] if lost else 0.0)


def _epochs(path: Path) -> dict[int, list[TileKey]]:
    if not path.exists():
        return {}
    try:
        with TileStore(path) as store:
            return {epoch: store.tiles(epoch) for epoch in store.numbers()}
    except StoreError as error:
        if str(error) != f"{path}: is empty":
            raise
        return {}


def _checked(path: Path, epoch: int, said: int) -> int:
    """The newest update in the file. Each tile must be as after one of its updates, and no older than the last of those that were said."""
    with TileStore(path) as store:
        found: dict[TileKey, Tile] = {}
        for key in store.tiles(epoch):
            tile = store.read(epoch, key)
            assert tile is not None
            found[key] = tile
    when = {key: int(tile.seen_s.max()) for key, tile in found.items()}
    newest = max(when.values(), default=0)
    car, due = Car(4096), dict[TileKey, int]()
    while car.updates < max(newest, said):
        key = car.update()
        if car.updates <= said:
            due[key] = car.updates
        if when.get(key) == car.updates:
            truth = car.map.tiles[key]
            same = all(getattr(found[key], name).tobytes() == getattr(truth, name).tobytes() for name in ("layers", "seen_s", "radars"))
            assert same, f"tile {key} is not as it was after update {car.updates}"
            del found[key]
    assert not found, f"tiles {list(found)} are as after no update of theirs"
    late = {key: update for key, update in due.items() if when.get(key, 0) < update}
    assert not late, f"updates {late} were said to be on disk, found {when}"
    return newest


def kills(folder: Path, times: int, seed: int = 0) -> list[Killed]:
    """One file, so many children, each killed at a random instant: one in five while it starts, perhaps before it says a word."""
    rng = random.Random(seed)
    path = folder / "killed.egmap"
    instants = [-rng.uniform(0.2, 1.0) if rng.random() < 0.2 else rng.uniform(0.0, LONGEST_S) for _ in range(times)]
    return [kill(path, after_s) for after_s in instants]


def summary(results: list[Killed]) -> dict[str, Any]:
    """Of kills that left what they should."""
    spoke = [one for one in results if one.said is not None]
    lost = np.array([one.lost_s for one in spoke])
    return {
        "kills": len(results),
        "before_the_first_word": len(results) - len(spoke),
        "updates_on_disk": sum(one.updates for one in spoke),
        "flush_s": FLUSH_S,
        "lost_s": {"p50": round(float(np.median(lost)), 3), "max": round(float(lost.max()), 3)},
    }


if __name__ == "__main__":
    child(Path(sys.argv[1]))
