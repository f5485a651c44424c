"""A simulated lidar as a recorder of ROS 2 would have kept it: every return of every turn, ground among them, in the lidar's own frame."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.recording.mcap_writer import McapWriter
from echogrid.topics.points import Points, encode_points
from echogrid.topics.topic import Message, Topic
from echogrid_training.drives.drive import LIDAR, MOUNT
from echogrid_training.drives.simulate import LidarView, from_first_pose
from echogrid_training.recording import EPOCH_NS
from echogrid_training.sensors import lidar
from echogrid_training.sensors.visibility import poses_at
from echogrid_training.towns.town import Town

CLOUDS = Topic("lidar", "sensor_msgs/msg/PointCloud2", "/lidar/points")
NEAR = 45.0  # m: farther returns are left out
SIGMA = 0.02  # m, of a return's distance


def write_lidar(town: Town, folder: Path) -> None:
    """`lidar.mcap`, and `lidar.toml`: where it is on the car. The same town gives the same points."""
    place = lidar.BASE_FROM_LIDAR
    (folder / MOUNT).write_text(f"x = {place.x:g}\ny = {place.y:g}\nz = {lidar.HEIGHT:g}  # m, in base\n", encoding="utf-8")
    with McapWriter(folder / LIDAR) as writer:
        for stamp_ns, points in turns(town):
            cloud = Points(stamp_ns, "lidar", points.astype(np.float32))
            writer.put(Message(CLOUDS, encode_points(cloud), stamp_ns, 0, 0))


def turns(town: Town) -> Iterator[tuple[int, Floats]]:
    """Stamp (ns), and points (N, 3) m with x ahead of the car, y left, z up, from the lidar; RATE a second."""
    town = from_first_pose(town)
    times = np.arange(town.ego.time[0], town.ego.time[-1], 1.0 / lidar.RATE)
    view, yaws = LidarView(town, times), poses_at(town.ego, times).yaw
    rng = np.random.default_rng(town.seed)
    for step, time in enumerate(times.tolist()):
        found, _ = view.turn(step)
        back = np.isfinite(found.distance) & (found.distance < NEAR)
        bearing = np.broadcast_to(lidar.bearings()[:, None], back.shape)[back] - yaws[step]
        distance = found.distance[back] + rng.normal(0.0, SIGMA, int(back.sum()))
        points = np.stack((distance * np.cos(bearing), distance * np.sin(bearing), found.height[back] - lidar.HEIGHT), axis=-1)
        yield EPOCH_NS + round(time * 1e9), points
