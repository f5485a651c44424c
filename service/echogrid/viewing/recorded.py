"""A recording as a tape: a drive through the whole chain, or what a service published, out of an MCAP file."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.can.signals import buses_of
from echogrid.config.loading import load_config
from echogrid.core.map.map_delta import Rectangle
from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.mapper import MapUpdate
from echogrid.errors import EchogridError
from echogrid.logs.drive import Drive, load_truth
from echogrid.logs.log import Log
from echogrid.logs.traffic import Traffic
from echogrid.pipeline import Pipeline
from echogrid.recording.published import Published
from echogrid.topics.announcer import MAP_FRAME, Announcer, Snapshot, Snapshots, occupancy_percent
from echogrid.topics.grids import Grid
from echogrid.viewing.scene import Frames, Scene
from echogrid.viewing.tape import Tape
from echogrid.viewing.wire import Plane

SECOND = 10**9  # ns
UNKNOWN, LEARNED, MEASURED = 0, 1, 2
MOST_TOLD = 300  # letters of a status in a sentence


class DriveFeed:
    """Maps a drive in `run`, as fast as it goes, and puts on the tape what the page shows of it, the map's age and origin too.

    `begin`: what a page is told before there is anything.
    """

    def __init__(self, drive: Drive, model: str | None) -> None:
        """Raises EchogridError for a configuration or a log that cannot be used."""
        self.tape = Tape()
        self._config = load_config(drive.config, model)
        self._pipeline = Pipeline(self._config, drive.config)
        self._traffic = Traffic(self._config, self._pipeline.signals)
        self._source = drive.config
        self._log = Log(drive.log)
        self._truth = load_truth(drive.truth)
        planes = ["OCCUPANCY", "SOURCE", "SEEN"] + (["TRUTH"] if self._truth is not None and self._truth.map is not None else [])
        name = drive.config.parent.name if drive.log.parent == drive.config.parent else drive.log.name
        self._scene = Scene({"shown": "drive", "name": name, "planes": planes, "timeline": True, "truth": self._truth is not None})
        self.begin = self._scene.whole()
        self._second: int | None = None  # of the drive, in which status and planes were told
        self._counted = (0, 0, 0)  # stamp in ns, cycles and frames of the last status

    def run(self, stop: threading.Event) -> None:
        """Until the end, or `stop`. Raises EchogridError for a recording that is torn, or gives no map; what came before is on the tape."""
        snapshots, announcer = Snapshots(), Announcer(self._config, self._pipeline.model.why)
        frames = self._scene.meta(announcer.about()) + self._true()
        try:
            for update in self._updates():
                if stop.is_set():
                    return
                snapshot = snapshots.take(self._pipeline.mapper, update, self._config.publish)
                if snapshot is not None:
                    frames += self._shown(snapshot)
                    self.tape.add(update.ego.stamp_ns, frames, self._scene)
                    self.tape.done, frames = self._log.progress, []
        except EchogridError as torn:
            if not self.tape.empty or not self._log.messages:
                raise
            raise EchogridError(f"{torn}; {self._why_no_map()}") from torn
        self.tape.done = 1.0
        if self.tape.empty:
            raise EchogridError(f"{self._log.path}: {self._why_no_map()}")

    def _updates(self) -> Iterator[MapUpdate]:
        for batch in self._log.batches():
            buses = buses_of(batch, self._config.bus)
            self._traffic.take(batch, buses)
            yield from (update for _, update in self._pipeline.take(batch, buses) if update is not None)

    def _why_no_map(self) -> str:
        health = self._pipeline.health
        if not self._traffic.heard:
            return self._traffic.nothing_known(self._source, health)
        return f"no map came of it: {self._traffic.why_no_map(health, self._pipeline.state(0).reasons)}"

    def _true(self) -> Frames:
        truth = self._truth
        if truth is None:
            return []
        if truth.map is None:
            return self._scene.truth(truth.poses[:, :2], None, 0, 0)
        cell = self._config.grid.cell
        row, column = round(truth.map.origin[1] / cell), round(truth.map.origin[0] / cell)
        return self._scene.truth(truth.poses[:, :2], occupancy_percent(truth.map.log_odds), row, column)

    def _shown(self, snapshot: Snapshot) -> Frames:
        update, scene, cell = snapshot.update, self._scene, self._config.grid.cell
        ego, seen = update.ego, snapshot.seen
        frames = scene.pose(ego.stamp_ns, ego.odom_from_base, ego.speed, ego.yaw_rate)
        frames += scene.detections(ego.stamp_ns, *update.judged.near())
        grid = Grid(ego.stamp_ns, MAP_FRAME, cell, (seen.column * cell, seen.row * cell), occupancy_percent(snapshot.log_odds))
        frames += scene.window(grid, snapshot.epoch)
        second = ego.stamp_ns // SECOND
        if second != self._second:
            self._second = second
            frames += self._planes(seen, snapshot.log_odds) + scene.status(self._status(ego.stamp_ns), ego.stamp_ns)
        return frames

    def _planes(self, where: Rectangle, log_odds: LogOdds) -> Frames:
        """What is measured and what is learned only; when each cell was last in view."""
        occupancy = self._pipeline.mapper.map
        source = origin_of(log_odds, occupancy.measured(occupancy.window_of_layers(*where)))
        seen_s, _ = occupancy.window_of_views(*where)
        row, column = where.row, where.column
        return self._scene.cells(Plane.SOURCE, row, column, source) + self._scene.cells(Plane.SEEN, row, column, seen_s)

    def _status(self, stamp_ns: int) -> dict[str, Any]:
        """As a service says it; rates are per second of the drive."""
        state, epoch, health = self._pipeline.state(0), self._pipeline.mapper.epoch, self._pipeline.health
        last, self._counted = self._counted, (stamp_ns, health.cycles, health.frames)
        span = (stamp_ns - last[0]) * 1e-9
        rates = {"map_hz": (health.cycles - last[1]) / span, "frames_hz": (health.frames - last[2]) / span} if last[2] and span > 0 else {}
        counters = asdict(health) | {"pose": self._pipeline.pose(0)}
        return {"state": state.name, "reasons": state.reasons, "epoch": epoch, "rates": rates, "buses": {}, **counters}


class McapFeed:
    """Puts on the tape what a service published, in the file's order."""

    def __init__(self, path: Path) -> None:
        """Raises EchogridError for a file that cannot be read, or holds no map."""
        self.tape = Tape()
        self._published = Published(path)
        self._scene = Scene({"shown": "drive", "name": path.name, "planes": ["OCCUPANCY"], "timeline": True})
        self.begin = self._scene.whole()
        self._status: Mapping[str, Any] | None = None  # the last

    def run(self, stop: threading.Event) -> None:
        """As DriveFeed's."""
        scene, frames, epoch = self._scene, list[bytes](), 0
        for item in self._published:
            if stop.is_set():
                return
            if item.status is not None:
                self._status = item.status
                epoch = item.status.get("epoch", 0)
                frames += scene.status(item.status, item.stamp_ns)
            if item.meta is not None:
                frames += scene.meta(item.meta)
            if item.odometry is not None:
                frames += scene.pose(item.stamp_ns, item.odometry.pose, item.odometry.speed, item.odometry.yaw_rate)
            if item.judged is not None:
                frames += scene.detections(item.stamp_ns, item.judged.points, item.judged.radars, item.judged.verdicts)
            if item.window is not None:
                frames += scene.window(item.window, epoch)
                self.tape.add(item.stamp_ns, frames, scene)
                self.tape.done, frames = self._published.progress, []
        self.tape.done = 1.0
        if self.tape.empty:
            raise EchogridError(f"{self._published.path}: holds no map of echogrid: {self._why_no_map()}")

    def _why_no_map(self) -> str:
        said = ["nothing was published on /echogrid/map"]
        if self._status is not None:
            reasons = self._status.get("reasons")
            told = "; ".join(map(str, (self._status.get("state"), *(reasons if isinstance(reasons, list) else ()))))[:MOST_TOLD]
            said.append(f"its last status is {''.join(letter if letter.isprintable() else '?' for letter in told)}")
        if self._published.frames:
            said.append("with -c echogrid.toml the CAN frames in it are mapped")
        return "; ".join(said)


def origin_of(log_odds: LogOdds, measured: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """UNKNOWN, LEARNED or MEASURED of each cell."""
    return np.where(log_odds == 0, UNKNOWN, np.where(measured, MEASURED, LEARNED)).astype(np.uint8)
