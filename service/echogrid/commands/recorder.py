"""What a drive through the chain leaves: the map's files, and a summary of it in numbers."""

from __future__ import annotations

import json
import resource
import time
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch
from echogrid.commands.state_log import StateLog
from echogrid.core.kernels.dispatch import COMPILED, WHY
from echogrid.core.map.tile import SIDE
from echogrid.core.mapper import MapUpdate
from echogrid.core.messages import Floats
from echogrid.core.motion.way import Way
from echogrid.files import named, whole
from echogrid.logs.drive import Truth
from echogrid.maps.map_files import FILES, too_wide, write_map
from echogrid.pipeline import Pipeline


@dataclass(slots=True)
class Recorder:
    """Remembers what a summary needs: the trajectory in the newest map, the times of the cycles, the span of the log."""

    pipeline: Pipeline
    way: Way = field(default_factory=Way)
    epoch: int = 0  # of the way's map
    left: int = 0  # tiles that the maps before it had no room for
    cycle_s: array[float] = field(default_factory=lambda: array("d"))
    first_s: float | None = None
    last_s: float = 0.0
    started: float = field(default_factory=time.perf_counter)
    states: StateLog = field(default_factory=StateLog)

    def take(self, batch: FrameBatch, buses: NDArray[np.int64]) -> Iterator[tuple[int, MapUpdate | None]]:
        """As the pipeline's; passes the frames on and notes what they did."""
        if self.first_s is None and len(batch):
            self.epoch = self.pipeline.mapper.epoch  # a store may hold maps already
            self.first_s = float(batch.stamps[0])
        newest = np.maximum.accumulate(batch.stamps)
        before = time.perf_counter()
        for end, update in self.pipeline.take(batch, buses):
            if update is not None:
                self.cycle_s.append(time.perf_counter() - before)
            self._look(float(newest[end - 1]))
            yield end, update
            before = time.perf_counter()

    def _look(self, newest_s: float) -> None:
        mapper = self.pipeline.mapper
        self.last_s = max(self.last_s, newest_s)
        now = self.last_s - (self.first_s or 0.0)
        if mapper.epoch != self.epoch:
            self.epoch = mapper.epoch
            self.left = mapper.map.forgotten
            self.way.clear()
            self.states.new_map(now, mapper.watch.why_empty or "")
        if self.states.due(now):
            self.states.look(now, self.pipeline.state(0))
        self.way.follow(mapper.odometry.states)

    def write(self, out: Path, truth: Truth | None, faults: Sequence[str] = (), notes: Sequence[str] = ()) -> dict[str, Any]:
        """Ends the last cycle and writes all files into a folder, which is made; returns the summary, with what the recording is like.

        Where no cycle was mapped, that is the summary alone.
        """
        self.pipeline.mapper.end_cycle()
        self.pipeline.mapper.learn()
        out.mkdir(parents=True, exist_ok=True)
        occupancy = self.pipeline.mapper.map
        with named(out):
            for name in ("summary.json", *FILES):  # of an earlier run: should this one end here, none is beside those of another drive
                (out / name).unlink(missing_ok=True)
            digest, written = write_map(out, occupancy, *self.way.arrays()) if self.pipeline.health.cycles else (None, [])
        wide = too_wide(occupancy)
        faults, notes = [*faults, *([] if wide is None else [wide])], [*notes, *self._forgotten()]
        if self.first_s is not None:
            self.states.look(self.last_s - self.first_s, self.pipeline.state(0))
        known = "map.png" in written or wide is not None
        summary = self._summary(digest, known, truth) | {"faults": faults, "notes": notes}
        if truth is not None and len(self.way) and "trajectory_rmse_m" not in summary:
            notes.append("the true poses beside the recording are of other times, and are not used")
        summary["files"] = sorted([*written, "summary.json"])
        with named(out), whole(out / "summary.json") as partial:
            partial.write_text(json.dumps(summary, indent=2) + "\n")
        return summary

    def _forgotten(self) -> list[str]:
        """What the map lacks."""
        occupancy = self.pipeline.mapper.map
        lost, side = occupancy.forgotten - self.left, SIDE * occupancy.spec.cell
        what = f"{lost} tiles of {side:g} x {side:g} m, those longest out of view, are not in the map: there was no room for more than"
        return [f"{what} {occupancy.max_tiles} in memory (map.max_tiles, map.max_mib); --store FILE.egmap keeps all"] if lost else []

    def _summary(self, digest: str | None, known: bool, truth: Truth | None) -> dict[str, Any]:
        health = self.pipeline.health
        cycle_ms = np.array(self.cycle_s or (0.0,)) * 1e3
        state = self.pipeline.state(0)
        summary: dict[str, Any] = {
            "model": self.pipeline.model.why,
            "kernels": WHY,
            "state": state.name,
            "reasons": state.reasons,
            "worst_state": self.states.worst,
            "seconds": {name: round(seconds, 2) for name, seconds in self.states.seconds.items()},
            "changes": self.states.changes,
            "changes_left_out": self.states.left_out,
            "epoch": self.epoch,
            "maps_begun": self.states.maps,
            "not_to_be_trusted": self.states.trusted() if known else "it is empty",
            "drive_s": round(self.last_s - (self.first_s or 0.0), 3),
            "wall_s": round(time.perf_counter() - self.started, 3),
            "frames": health.frames,
            "unknown_frames": health.unknown_frames,
            "bad_frames": health.bad_frames,
            "lost_frames": health.lost_frames,
            "cycles": health.cycles,
            "scans_without_pose": health.scans_without_pose,
            "scans": {name: sensor.as_dict() for name, sensor in health.sensors.items()},
            "detections": health.detections,
            "static_detections": health.static_detections,
            "distance_m": round(self.pipeline.mapper.odometry.distance, 2),
            "pose": self.pipeline.pose(0),
            "learned": self.pipeline.mapper.odometry.errors.learned(),
            "cycle_ms": {
                "p50": round(float(np.percentile(cycle_ms, 50)), 3),
                "p99": round(float(np.percentile(cycle_ms, 99)), 3),
                "max": round(float(cycle_ms.max()), 3),
            },
            "rss_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
            "map_sha256": digest,
        }
        off = None if truth is None else rmse(*self.way.arrays(), truth)
        return summary if off is None else summary | {"trajectory_rmse_m": round(off, 3)}


def rmse(stamps: NDArray[np.int64], poses: Floats, truth: Truth) -> float | None:
    """Root mean square distance (m) of dead reckoning, (N,) ns and (N, 3), from the true positions, both from its first pose on.

    None where no time is that of both.
    """
    inside = (stamps >= truth.stamp_ns[0]) & (stamps <= truth.stamp_ns[-1])
    if not inside.any():
        return None
    # Relative to the first stamp: nanoseconds since 1970 do not fit a float64.
    seconds = (stamps[inside] - truth.stamp_ns[0]) * 1e-9
    true_seconds = (truth.stamp_ns - truth.stamp_ns[0]) * 1e-9
    x, y, yaw = (np.interp(seconds, true_seconds, truth.poses[:, axis]) for axis in range(3))
    first_x, first_y, first_yaw = poses[inside][0]
    turn = first_yaw - yaw[0]
    c, s = np.cos(turn), np.sin(turn)
    true = np.stack((c * (x - x[0]) - s * (y - y[0]) + first_x, s * (x - x[0]) + c * (y - y[0]) + first_y), axis=1)
    return float(np.sqrt(((poses[inside, :2] - true) ** 2).sum(axis=1).mean()))


def report(summary: dict[str, Any], out: Path, *, as_json: bool = False) -> None:
    """Prints what a summary says, and where the files are; `as_json`: all of it, with the folder as `out`."""
    if as_json:
        print(json.dumps({"out": str(out), **summary}))
        return
    faster = summary["drive_s"] / max(summary["wall_s"], 1e-9)
    scans = sum(counts["complete"] for counts in summary["scans"].values())
    print(f"{summary['drive_s']:.1f} s and {summary['distance_m']:.0f} m driven, {scans} scans in {summary['cycles']} map updates")
    print(f"{summary['wall_s']:.1f} s on this machine, {faster:.1f} times the drive's pace; {summary['cycle_ms']['p50']:.1f} ms per update")
    if "trajectory_rmse_m" in summary:
        print(f"dead reckoning is {summary['trajectory_rmse_m']:.2f} m RMSE from the true positions")
    states = [f"{name} {seconds:.1f} s" for name, seconds in summary["seconds"].items() if seconds]
    print(f"states: {', '.join(states)}; {len(summary['maps_begun'])} new maps" if states else "states: none")
    if not COMPILED:
        print(f"kernels: {WHY}")
    picture = f"map: {out / 'map.png'}" if "map.png" in summary["files"] else "map: none"
    print(f"{picture}, numbers: {out / 'summary.json'}")
    if summary["not_to_be_trusted"] is not None:
        print(f"the map is not to be trusted: {summary['not_to_be_trusted']}")
    for note in summary["notes"]:
        print(f"note: {note}")
