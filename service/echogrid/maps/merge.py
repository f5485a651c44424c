"""Stored maps of several drives into one store, here or on a Dask cluster."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from echogrid.core.map.merge import Placement, Source, merge_tile, placement, touched
from echogrid.core.map.tile import MOST_RADARS, Tile, TileKey
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.maps.cluster import cluster
from echogrid.maps.files import may_write, new_store, open_store
from echogrid.maps.stored_epoch import OnProgress, StoredEpoch
from echogrid.store.epoch import Description
from echogrid.store.store_file import SUFFIX

AT_ONCE = 128  # merged tiles that are in memory
SEVERAL = "several"  # vehicles


@dataclass(frozen=True, slots=True)
class Input:
    """A map to merge and its pose in the merged one; `epoch`: None is the newest."""

    path: Path
    epoch: int | None
    merged_from_map: SE2

    def __str__(self) -> str:
        """As it is typed, without its pose."""
        return f"{self.path}" if self.epoch is None else f"{self.path}@{self.epoch}"

    @classmethod
    def parse(cls, text: str) -> Input:
        """`FILE.egmap[@EPOCH][:X,Y,YAW_DEG]`, m and degrees. Raises EchogridError."""
        found = re.fullmatch(r"(.+?\.egmap)(?:@(\d+))?(?::([^,:]+),([^,:]+),([^,:]+))?", text)
        try:
            if found is None:
                raise ValueError
            x, y, yaw_deg = (float(number) for number in found.group(3, 4, 5)) if found[3] else (0.0, 0.0, 0.0)
            if not all(map(math.isfinite, (x, y, yaw_deg))):
                raise ValueError
        except ValueError:
            raise EchogridError(f"'{text}': expected FILE{SUFFIX}[@EPOCH][:X,Y,YAW_DEG], metres and degrees") from None
        return cls(Path(found[1]), int(found[2]) if found[2] else None, SE2(x, y, math.radians(math.fmod(yaw_deg, 360.0))))


@dataclass(frozen=True, slots=True)
class Part:
    """A stored map as a worker finds it: by its path, which is the same for all of them."""

    path: Path
    epoch: int
    placement: Placement
    bits: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Job:
    """One tile of the merged map, and the maps that reach it, in their order."""

    key: TileKey
    parts: tuple[Part, ...]


Work = Callable[[Job], Tile | None]
Engine = Callable[[Work, Sequence[Job]], list[Tile | None]]


def merge(
    inputs: Sequence[Input], out: Path, *, scheduler: str | None = None, force: bool = False, on_progress: OnProgress | None = None
) -> str:
    """Writes a store with one epoch; returns a sentence on what is in it. `scheduler`: address of a Dask scheduler; None: in this process.

    Raises EchogridError for maps that do not fit each other, a cluster that does not answer, and workers that cannot read the files.
    """
    if out.suffix != SUFFIX:
        raise EchogridError(f"{out}: expected a name that ends with {SUFFIX}")
    may_write(out, force, [one.path for one in inputs])
    what, jobs = plan(inputs)
    work = partial(run, kind=what.kind, clamp=what.clamp)
    written = 0
    with _engine(scheduler) as engine, new_store(out) as store:
        number = store.begin(what)
        for first in range(0, len(jobs), AT_ONCE):
            batch = jobs[first : first + AT_ONCE]
            tiles = {job.key: tile for job, tile in zip(batch, engine(work, batch), strict=True) if tile is not None}
            newest_s = max((int(tile.seen_s.max()) for tile in tiles.values()), default=0)
            store.write(number, tiles, newest_s * 10**9)
            written += len(tiles)
            if on_progress is not None:
                on_progress((first + len(batch)) / len(jobs))
    return f"{out}: {len(inputs)} map{'s' * (len(inputs) > 1)} in {written} tiles, radars {', '.join(what.radars) or 'not known'}"


def plan(inputs: Sequence[Input]) -> tuple[Description, list[Job]]:
    """What the merged map is, and its tiles by row and column. Raises EchogridError where the maps are not of one kind."""
    radars: list[str] = []
    reach: dict[TileKey, list[Part]] = {}
    first: Description | None = None
    begun_ns, vehicles = [], set()
    for one in inputs:
        with open_store(one.path) as store:
            stored = StoredEpoch(store, one.epoch)
        what = stored.description
        first = first or what
        for name, mine, theirs in (
            ("cells", f"{what.cell} m", f"{first.cell} m"),
            ("fusion", what.kind, first.kind),
            ("calibration", what.calibration, first.calibration),
            ("clamp", what.clamp, first.clamp),
        ):
            if mine != theirs:
                raise EchogridError(f"{one}: {name}: found {mine}, expected {theirs} as in {inputs[0]}, to merge the two")
        begun_ns.append(what.begun_ns)
        vehicles.add(what.vehicle)
        radars += [radar for radar in what.radars if radar not in radars]
        if len(radars) > MOST_RADARS:
            raise EchogridError(f"{one}: radars: found {len(radars)} names in the maps up to here, expected at most {MOST_RADARS}")
        bits = tuple(radars.index(radar) for radar in what.radars)
        part = Part(one.path.resolve(), stored.number, placement(one.merged_from_map, what.cell), bits)
        for key in {key for tile in stored.keys for key in touched(tile, part.placement)}:
            reach.setdefault(key, []).append(part)
    if first is None:
        raise EchogridError("no map to merge was given")
    vehicle = vehicles.pop() if len(vehicles) == 1 else SEVERAL
    what = Description(min(begun_ns), vehicle, first.cell, first.kind, first.clamp, first.calibration, tuple(radars))
    return what, [Job(key, tuple(reach[key])) for key in sorted(reach)]


def run(job: Job, kind: str, clamp: float) -> Tile | None:
    """What one process does for one tile; any one gives the same bits. Raises EchogridError where a file cannot be read."""
    return merge_tile(job.key, _sources(job.parts), kind, clamp)


def _sources(parts: Sequence[Part]) -> Iterator[Source]:
    """One after the other, so that no more than one file is open, however many maps there are of a place."""
    for part in parts:
        with open_store(part.path) as store:
            yield Source(partial(store.read, part.epoch), part.placement, part.bits)


@contextmanager
def _engine(scheduler: str | None) -> Iterator[Engine]:
    """What carries a batch of jobs out, in order."""
    if scheduler is None:
        yield lambda work, jobs: [work(job) for job in jobs]
        return
    with cluster(scheduler) as gather:
        yield gather
