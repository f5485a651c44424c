"""docs/simulator.md: simulated drives beside recorded ones, figure by figure."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.drives import nuscenes, radarscenes
from echogrid_training.drives.simulate import LidarView, from_first_pose, simulate
from echogrid_training.realism.figures import GROSS, RINGS, Detections, biases, by_ring, detections, gross_share, spread, surface_distance
from echogrid_training.realism.recorded import astyx_distances, kitti_truth, occupied_share, standing
from echogrid_training.recording import EPOCH_NS, Recording, Track
from echogrid_training.sensors.episode import NEAR, draw_episode
from echogrid_training.sensors.visibility import poses_at
from echogrid_training.sources import load_text
from echogrid_training.tasks import processes
from echogrid_training.towns.town import Town
from echogrid_training.worlds.layout import make_town

BEGIN, END = "<!-- table -->", "<!-- end of table -->"


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """One drive's figures, simulated or recorded; what a source cannot say is None."""

    counts: Floats | None  # (3,) 5th, 50th, 95th percentile of detections per scan within NEAR
    sigma: float | None  # m/s
    bias: float | None  # m/s, the largest of the radars, by amount
    gross: float | None
    rcs: Floats | None  # (3,) dBsm
    rings: list[tuple[float, float]] | None = None
    occupied: float | None = None


def simulated(seed: int, seconds: float) -> Drive:
    """A drive of the train family without traffic, so that every detection is of something that stands."""
    town = dataclasses.replace(make_town("train", seed, seconds), movers=())
    recording, truth = simulate(town, draw_episode(seed, "train"))
    found = detections(recording)
    way = recording.truth
    poses = [SE2(*map(float, pose)) for pose in zip(way.x[::100], way.y[::100], way.yaw[::100], strict=True)]
    return _drive(found, rings=by_ring(*_distances(town, recording)), occupied=occupied_share(truth, poses))


def simulated_drives(count: int, seconds: float, workers: int, track: Track) -> list[Drive]:
    """The figures of the first `count` seeds, worked out in several processes."""
    with processes(workers) as pool:
        return list(track(pool.map(simulated, range(count), [seconds] * count), f"simulating {count} drives"))


def _drive(
    found: Detections, *, static: bool = True, rings: list[tuple[float, float]] | None = None, occupied: float | None = None
) -> Drive:
    kept = np.ones(len(found.residual), dtype=np.bool_) if static else np.abs(found.residual) < GROSS
    near = dataclasses.replace(found, residual=found.residual[kept], sensor=found.sensor[kept])
    return Drive(
        counts=np.percentile(found.counts, (5, 50, 95)),
        sigma=spread(near.residual),
        bias=max(biases(near), key=abs),
        gross=gross_share(found.residual) if static else None,
        rcs=np.percentile(found.rcs, (5, 50, 95)),
        rings=rings,
        occupied=occupied,
    )


def _distances(town: Town, recording: Recording) -> tuple[Floats, Floats]:
    """Range (N,) of detections of about 40 scans, and their distance (N,) m to the nearest point that the lidar shows at that moment."""
    town = from_first_pose(town)
    mounts = {radar.name: radar.base_from_sensor for radar in recording.radars}
    scans = recording.scans[:: max(1, len(recording.scans) // 40)]
    times = np.array([(scan.stamp_ns - EPOCH_NS) * 1e-9 for scan in scans])
    view, poses = LidarView(town, times), poses_at(town.ego, times)
    ranges, distances = [np.empty(0)], [np.empty(0)]
    for step, scan in enumerate(scans):
        truth_from_base = SE2(float(poses.x[step]), float(poses.y[step]), float(poses.yaw[step]))
        in_sensor = np.stack((scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)), axis=1)
        surfaces = view.points(step)
        if len(surfaces) and len(scan):
            ranges.append(scan.range)
            distances.append(surface_distance((truth_from_base @ mounts[scan.sensor]).apply(in_sensor), surfaces))
    return np.concatenate(ranges), np.concatenate(distances)


def recorded(nuscenes_folder: Path, radarscenes_file: Path, astyx_file: Path, kitti_file: Path) -> dict[str, Drive]:
    """The same figures of the recordings. nuScenes does not say what moves: its residuals are taken below 1 m/s, and no gross share."""
    drives: dict[str, Drive] = {}
    scenes = sorted(nuscenes_folder.glob("scene-*.npz"))
    if not scenes:
        raise EchogridError(f"{nuscenes_folder}: holds no scene-*.npz, expected a folder of them")
    for path in scenes:
        drives[f"nuScenes {path.stem.removeprefix('scene-')}"] = _drive(detections(nuscenes.load(path)), static=False)
    recording = radarscenes.load(radarscenes_file)
    recording = dataclasses.replace(recording, scans=sorted(recording.scans, key=lambda scan: scan.stamp_ns))
    drives["RadarScenes 105"] = _drive(detections(recording, standing(radarscenes_file, recording)))
    drives["Astyx"] = Drive(None, None, None, None, None, rings=by_ring(*astyx_distances(astyx_file)))
    truth, poses = kitti_truth(kitti_file)
    drives["KITTI"] = Drive(None, None, None, None, None, occupied=occupied_share(truth, poses[::5]))
    return drives


Figure = tuple[str, Callable[[Drive], float | None], str]


def figures() -> list[Figure]:
    """What is compared: name, how it is read off a drive, and the format of its numbers."""
    rows: list[Figure] = [
        (f"detections per scan within {NEAR:.0f} m, {name}", _at("counts", index), "{:.0f}")
        for index, name in enumerate(("5th percentile", "median", "95th percentile"))
    ]
    rows += [
        ("range-rate residual of standing things, robust sigma, m/s", lambda drive: drive.sigma, "{:.3f}"),
        ("largest bias of a radar's range rate, m/s, by amount", lambda drive: None if drive.bias is None else abs(drive.bias), "{:.3f}"),
        ("share of residuals beyond 1 m/s", lambda drive: drive.gross, "{:.3f}"),
    ]
    rows += [
        (f"RCS within {NEAR:.0f} m, dBsm, {name}", _at("rcs", index), "{:.1f}")
        for index, name in enumerate(("5th percentile", "median", "95th percentile"))
    ]
    for index, (low, high) in enumerate(RINGS):
        rows.append((f"median distance to the nearest lidar point, m, {low:.0f}–{high:.0f} m", _ring(index, 0), "{:.2f}"))
        rows.append((f"share of detections with none within 1 m, {low:.0f}–{high:.0f} m", _ring(index, 1), "{:.3f}"))
    return [*rows, ("occupied share of a patch's pixels", lambda drive: drive.occupied, "{:.3f}")]


def table(real: Mapping[str, Drive], sims: Sequence[Drive]) -> str:
    """Markdown: each figure's recorded values, the simulated drives' span, and whether all of the former lie in the latter."""
    lines = ["| figure | recorded | simulated drives, lowest … median … highest | inside |", "| --- | --- | --- | --- |"]
    for name, read, form in figures():
        found = {source: value for source, drive in real.items() if (value := read(drive)) is not None}
        values = np.array([value for drive in sims if (value := read(drive)) is not None and np.isfinite(value)])
        low, middle, high = values.min(), np.median(values), values.max()
        outside = [source for source, value in found.items() if not low <= value <= high]
        shown = ", ".join(f"{form.format(value)} ({source})" for source, value in found.items())
        span = " … ".join(form.format(value) for value in (low, middle, high))
        lines.append(f"| {name} | {shown} | {span} | {'yes' if not outside else 'not ' + ', '.join(outside)} |")
    return "\n".join(lines)


def put_into(document: Path, text: str) -> None:
    """Replaces the text between the document's marks. Raises EchogridError if it has none."""
    before, after = around(document)
    document.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")


def around(document: Path) -> tuple[str, str]:
    """The document's text before and behind its marks. Raises EchogridError if it has none."""
    before, begin, rest = load_text(document).partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise EchogridError(f"{document}: has no place for the table, expected the marks {BEGIN} and {END}")
    return before, after


def _at(field: str, index: int) -> Callable[[Drive], float | None]:
    def read(drive: Drive) -> float | None:
        values = getattr(drive, field)
        return None if values is None else float(values[index])

    return read


def _ring(ring: int, column: int) -> Callable[[Drive], float | None]:
    return lambda drive: None if drive.rings is None else drive.rings[ring][column]
