"""Tiny towns for tests: a room, a street, and tracks of constant motion."""

from __future__ import annotations

import numpy as np

from echogrid_training.towns.town import Material, Mover, Thing, Town, Track


def track(seconds: float, speed: float = 0.0, yaw_rate: float = 0.0, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> Track:
    """Constant motion, sampled at 100 Hz."""
    time = np.arange(round(100 * seconds) + 1) / 100
    heading = yaw + yaw_rate * time
    if yaw_rate:
        radius = speed / yaw_rate
        xs, ys = x + radius * (np.sin(heading) - np.sin(yaw)), y - radius * (np.cos(heading) - np.cos(yaw))
    else:
        xs, ys = x + speed * np.cos(yaw) * time, y + speed * np.sin(yaw) * time
    return Track(time, xs, ys, heading, np.full(len(time), speed), np.full(len(time), yaw_rate))


def box(
    material: Material, x: float, y: float, length: float, width: float, top: float = 3.0, bottom: float = 0.0, yaw: float = 0.0
) -> Thing:
    """A rectangle about (x, y), counter-clockwise."""
    corners = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1))) * (length / 2, width / 2)
    cos, sin = np.cos(yaw), np.sin(yaw)
    return Thing(material, corners @ np.array(((cos, sin), (-sin, cos))) + (x, y), True, bottom, top)


def line(material: Material, *points: tuple[float, float], top: float = 3.0, bottom: float = 0.0) -> Thing:
    """An open line."""
    return Thing(material, np.array(points, dtype=float), False, bottom, top)


def town(*things: Thing, ego: Track | None = None, movers: tuple[Mover, ...] = (), seed: int = 1) -> Town:
    return Town("tiny", "tiny", seed, things, (), movers, track(1.0) if ego is None else ego)


def room(length: float = 24.0, width: float = 16.0) -> tuple[Thing, ...]:
    """Four building walls around (0, 0), seen from inside."""
    x, y = length / 2, width / 2
    return (line(Material.BUILDING, (x, y), (x, -y), (-x, -y), (-x, y), (x, y)),)


def car_mover(path: Track) -> Mover:
    return Mover(Material.CAR, 4.5, 1.8, 1.5, path)


def street(seconds: float, speed: float = 8.0, seed: int = 3) -> Town:
    """Houses, kerbs, parked cars, trees, hedges and fences on both sides, and two cars that move."""
    rng, length = np.random.default_rng(seed), 100.0 + speed * seconds
    things = [line(Material.KERB, (-40.0, side * 5.2), (length, side * 5.2), top=0.12) for side in (-1, 1)]
    for side in (-1, 1):
        x = -40.0
        while x < length:
            wide = rng.uniform(8.0, 20.0)
            setback = rng.uniform(8.0, 13.0)
            things.append(box(Material.BUILDING, x + wide / 2, side * (setback + 5.0), wide, 10.0, top=8.0))
            if rng.uniform() < 0.5:
                material = (Material.HEDGE, Material.FENCE, Material.WALL)[int(rng.integers(3))]
                things.append(line(material, (x, side * 7.2), (x + wide, side * 7.2), top=1.2))
            x += wide + rng.choice((0.0, 3.0, 6.0))
        for x in np.arange(-38.0, length, 6.0):
            if rng.uniform() < 0.55:
                things.append(box(Material.CAR, x, side * 4.1, 4.4, 1.8, top=1.5, yaw=rng.normal(0.0, 0.02)))
            if rng.uniform() < 0.12:
                things.append(box(Material.POLE, x + 3.0, side * 5.6, 0.2, 0.2, top=6.0))
            if rng.uniform() < 0.15:
                things.append(box(Material.TREE, x + 3.0, side * 6.2, 0.4, 0.4, top=4.0))
                things.append(box(Material.OVERHEAD, x + 3.0, side * 6.2, 4.0, 4.0, bottom=2.5, top=7.0))
    movers = (
        car_mover(track(seconds, speed + 1.0, x=15.0, y=-1.6)),
        car_mover(track(seconds, 10.0, x=120.0, y=1.8, yaw=np.pi)),
    )
    return town(*things, ego=track(seconds, speed, y=-1.6), movers=movers, seed=seed)
