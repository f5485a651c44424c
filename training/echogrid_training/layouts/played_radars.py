"""Corner radars for a data set that has none, played from its lidar: so that a network can be taught by a real lidar's truth.

Each returns some of the nearest things in its field of view, with noise. Everything seems to stand, since a lidar knows no Doppler.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from echogrid.config.tables import Body
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import static_range_rate
from echogrid_training.labelling.clouds import Cloud
from echogrid_training.labelling.ground import flat
from echogrid_training.labelling.lidar_mount import Pose3
from echogrid_training.labelling.lidar_turn import standing
from echogrid_training.layouts.with_lidar import along
from echogrid_training.recording import RadarMount, Truth

FOV, RANGE = math.radians(150.0), 25.0  # rad, m
STEP = math.radians(1.0)  # of bearing, in which there is one detection at most
SEEN = 0.35  # share of the nearest returns that a scan has
SIGMA, SIGMA_AZIMUTH, SIGMA_RATE = 0.08, math.radians(0.6), 0.1  # m, rad, m/s


def corners(body: Body) -> tuple[RadarMount, ...]:
    """At the corners of the car, looking outwards."""
    front, rear, side = body.length - body.rear_overhang - 0.2, 0.2 - body.rear_overhang, body.width / 2 - 0.1
    places = {"front_left": (front, side, 45), "front_right": (front, -side, -45), "rear_left": (rear, side, 135)}
    places["rear_right"] = (rear, -side, -135)
    return tuple(RadarMount(name, SE2(x, y, math.radians(yaw)), FOV) for name, (x, y, yaw) in places.items())


def played(turns: Iterable[Cloud], pose: Pose3, poses: Truth, body: Body, seed: int = 0) -> list[RadarScan]:
    """A scan of each radar a turn. The same turns and seed give the same detections."""
    rng, radars, scans = np.random.default_rng(seed), corners(body), list[RadarScan]()
    for turn in turns:
        points = pose.apply(turn.points)
        flat_points = points[standing(points, flat(points, pose.place), body)][:, :2]
        (speed,), (turning,) = along(poses, np.array([(turn.stamp_ns - poses.stamp_ns[0]) * 1e-9]))
        for radar in radars:
            mount = Mount(radar.base_from_sensor, radar.fov / 2, RANGE)
            distance, azimuth = _nearest(radar.base_from_sensor.inverse().apply(flat_points[mount.sees(flat_points)]))
            kept = rng.uniform(size=len(distance)) < SEEN
            distance, azimuth = distance[kept], azimuth[kept]
            rate, _ = static_range_rate(azimuth, mount, float(speed), float(turning))
            count = len(distance)
            noisy = (
                distance + rng.normal(0, SIGMA, count),
                azimuth + rng.normal(0, SIGMA_AZIMUTH, count),
                rate + rng.normal(0, SIGMA_RATE, count),
            )
            scans.append(RadarScan(radar.name, turn.stamp_ns, turn.stamp_ns, *noisy, rng.normal(-8.0, 6.0, count)))
    return scans


def _nearest(points: Floats) -> tuple[Floats, Floats]:
    """Range and azimuth of the nearest of points (N, 2) in the sensor's frame in each STEP of bearing, where there is one."""
    distance, azimuth = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    order = np.lexsort((distance, np.floor(azimuth / STEP)))
    _, first = np.unique(np.floor(azimuth[order] / STEP), return_index=True)
    return distance[order[first]], azimuth[order[first]]
