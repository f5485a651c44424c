"""A few reflecting points, a car that drives past them, and the CAN log that it records: geometry by finite differences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import can
import numpy as np
from tests.support import frames
from tests.support.frames import Detection, radar_cycle, wheel_speeds, yaw_rate

Path2 = Callable[[float], tuple[float, float, float]]  # time s -> x, y, yaw of a frame in odom
Thing = Callable[[float], np.ndarray]  # time s -> its points (N, 2) in odom
RADARS = {
    "front_left": (3.6, 0.8, 45.0),
    "front_right": (3.6, -0.8, -45.0),
    "rear_left": (-0.8, 0.8, 135.0),
    "rear_right": (-0.8, -0.8, -135.0),
}

CONFIG = frames.CONFIG.split("[[radar]]")[0] + "\n".join(
    f'[[radar]]\nname = "{name}"\nbus = "can0"\nx = {x}\ny = {y}\nyaw_deg = {yaw}\nid_offset = {16 * n}\n'
    for n, (name, (x, y, yaw)) in enumerate(RADARS.items())
)


def straight(speed: float) -> Path2:
    return lambda t: (speed * t, 0.0, 0.0)


def circle(speed: float, rate: float) -> Path2:
    """Starts at the origin along x and turns left."""
    return lambda t: (speed / rate * math.sin(rate * t), speed / rate * (1 - math.cos(rate * t)), rate * t)


def standing(points: Sequence[tuple[float, float]]) -> Thing:
    """Points (N, 2) in odom that do not move."""
    fixed = np.array(points, dtype=float).reshape(-1, 2)
    return lambda t: fixed


def moving(points: Sequence[tuple[float, float]], velocity: tuple[float, float]) -> Thing:
    fixed = np.array(points, dtype=float).reshape(-1, 2)
    return lambda t: fixed + np.array(velocity) * t


def rectangle(x: float, y: float, length: float = 4.4, width: float = 1.8, step: float = 0.4) -> list[tuple[float, float]]:
    """The outline of a car as points."""
    xs, ys = np.arange(0, length + 1e-9, step) + x - length / 2, np.arange(0, width + 1e-9, step) + y - width / 2
    sides = [(float(a), b) for a in xs for b in (y - width / 2, y + width / 2)]
    return sides + [(a, float(b)) for b in ys for a in (x - length / 2, x + length / 2)]


def polar(path: Path2, things: Sequence[Thing], mount: tuple[float, float, float], at: float) -> tuple[np.ndarray, np.ndarray]:
    """Range and azimuth of all points of the things from a radar's mount (m, m, degrees) at a time."""
    x, y, yaw = path(at)
    mount_x, mount_y, mount_deg = mount
    origin = (x + mount_x * math.cos(yaw) - mount_y * math.sin(yaw), y + mount_x * math.sin(yaw) + mount_y * math.cos(yaw))
    points = np.concatenate([thing(at) for thing in things]) - origin
    azimuth = np.arctan2(points[:, 1], points[:, 0]) - yaw - math.radians(mount_deg)
    return np.hypot(points[:, 0], points[:, 1]), np.angle(np.exp(1j * azimuth))


def record(path: Path2, things: Sequence[Thing], seconds: float, *, age: float = 0.02, seed: int = 0) -> list[can.Message]:
    """The frames of a drive in the order of their times, motion every 10 ms, each radar every 50 ms with its own phase."""
    random = np.random.default_rng(seed)
    messages = []
    step = 1e-3
    for n in range(round(seconds * 100) + 1):
        time = n * 0.01
        (x0, y0, a0), (x1, y1, a1) = path(time - step), path(time + step)
        speed = math.hypot(x1 - x0, y1 - y0) / (2 * step)
        messages += [wheel_speeds(speed, n, 100 + time), yaw_rate((a1 - a0) / (2 * step), n, 100 + time + 0.001)]
    for number, mount in enumerate(RADARS.values()):
        for cycle in range(round(seconds * 20)):
            time = 0.1 + cycle * 0.05 + number * 0.011
            if time + age > seconds:
                break
            range_, azimuth = polar(path, things, mount, time)
            before, after = (polar(path, things, mount, time + shift)[0] for shift in (-step, step))
            range_rate = (after - before) / (2 * step)
            seen = np.flatnonzero((np.abs(azimuth) < math.radians(70)) & (range_ < 30))
            seen = random.permutation(seen)[:40]
            detections: list[Detection] = [(float(range_[i]), float(azimuth[i]), float(range_rate[i])) for i in seen]
            messages += radar_cycle(detections, cycle, 100 + time + age, offset=16 * number, age_ms=age * 1e3)
    return sorted(messages, key=lambda message: message.timestamp)


def write_drive(folder: Path, messages: Sequence[can.Message], config: str = CONFIG) -> Path:
    """A drive folder with a plain candump log."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "echogrid.toml").write_text(config)
    with can.CanutilsLogWriter(folder / "can.log") as writer:
        for message in messages:
            writer.on_message_received(message)
    return folder
