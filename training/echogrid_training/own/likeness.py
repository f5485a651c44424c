"""What a drive shows of its car's radars, for towns that are simulated as this car would see them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.evidence.raster import Image
from echogrid.core.map.look_map import Calibration
from echogrid.core.messages import RadarScan
from echogrid.pipeline import Pipeline
from echogrid_training.drives.samples import Unwritten
from echogrid_training.evaluation.recorded.drive import RealDrive
from echogrid_training.own.measure import heard
from echogrid_training.recording import Track, untracked
from echogrid_training.sensors.episode import NEAR
from echogrid_training.sensors.likeness import Likeness, Radar

UNHEARD_DEG = 1.5  # one sigma of a mount's yaw of which a drive says nothing
UNKNOWN_DEG = 0.4  # of a mount's yaw, however long the drive: what Doppler cannot tell from bends and azimuth errors (docs/motion.md)


def likenesses(sources: Sequence[Path], configuration: Path | None, track: Track = untracked) -> tuple[Likeness, ...]:
    """Of each drive. Raises EchogridError."""
    return tuple(likeness(heard(source, configuration)[0]) for source in track(sources, "looking at drives"))


def likeness(drive: RealDrive) -> Likeness:
    config = load_config(drive.config)
    scans = [item for _, item in drive.items if isinstance(item, RadarScan)]
    near = [scan.range < NEAR for scan in scans]
    rcs = np.concatenate([scan.rcs[which] for scan, which in zip(scans, near, strict=True)])
    rcs = rcs[np.isfinite(rcs)]
    off = azimuth_errors(drive)
    return Likeness(
        body=config.body,
        radars=tuple(
            Radar(one.name, one.x, one.y, math.radians(one.yaw_deg), math.radians(one.fov_deg), *off[one.name]) for one in config.radar
        ),
        cycle=round(float(np.median(periods(scans))), 4),
        density=float(np.mean([which.sum() for which in near])),
        most=max(map(len, scans)),
        reach=float(max(scan.range.max(initial=0.0) for scan in scans)),
        ambiguity=float(np.median([scan.ambiguity for scan in scans])),
        rcs=float(np.median(rcs)) if len(rcs) else None,
    )


def periods(scans: Sequence[RadarScan]) -> np.ndarray:
    """(N,) s between a radar's scans."""
    stamps: dict[str, list[int]] = {}
    for scan in scans:
        stamps.setdefault(scan.sensor, []).append(scan.stamp_ns)
    return np.concatenate([np.diff(one) for one in stamps.values()]) * 1e-9


def azimuth_errors(drive: RealDrive) -> dict[str, tuple[float, float]]:
    """By radar: by how much (rad) its azimuths are too large, by Doppler over the drive, and the sigma of that.

    A radar that is turned by more than the configuration says shows azimuths that are too small by as much.
    """
    mapper = Pipeline(load_config(drive.config, "analytic"), drive.config).mapper
    mapper.map, mapper.infer = Unwritten(mapper.map.spec, Calibration()), lambda _: Image((0,))  # no map is made
    for now_ns, item in drive.items:
        for _ in mapper.take(item, now_ns):
            pass
    said = mapper.odometry.errors.learned()
    out = {}
    for name in mapper.mounts:
        more, sigma = said.get(f"mount_yaw_deg.{name}", 0.0), said.get(f"mount_yaw_deg.{name}_sigma", UNHEARD_DEG)
        out[name] = math.radians(-more), math.radians(math.hypot(sigma, UNKNOWN_DEG))
    return out
