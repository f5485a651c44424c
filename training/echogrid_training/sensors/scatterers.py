"""What a town's things reflect of a radar's signal: points with a cross-section, and flat surfaces that mirror.

Which points a thing has follows published studies of cars and roadside objects (corners, wheel houses, windows, posts); the numbers are
set so that the simulated detections match recorded ones in count, cross-section and distance to the nearest surface.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from echogrid.core.messages import Floats
from echogrid_training.towns.town import Material, Mover, Thing

WAVES = 3  # of a scatterer's fading: enough for their sum to look normally distributed
ASPECT_LENGTH = 0.3  # m the sensor moves until a scatterer's fading is another one
RADAR_HEIGHT = 0.5  # m: what does not reach this height hides nothing

SCATTERER = np.dtype(
    [
        ("x", float),  # m
        ("y", float),
        ("rcs", float),  # dBsm, mean over time
        ("facing", float),  # rad, direction in which it reflects most
        ("width", float),  # rad off `facing` at which 3 dB are lost; inf: none anywhere
        ("height", float),  # m above a car's bumper: what is high is out of the beam when it is near
        ("spread", float),  # m, one sigma of where within a volume the reflection comes from
        ("beyond", float),  # m, detour of the signal's way
        ("flutter", float),  # m/s, one sigma of its own motion's range rate: legs, spokes
        ("into_x", float),  # m, to the middle of the body it belongs to; 0 for what has none
        ("into_y", float),
        ("vx", float),  # m/s over ground
        ("vy", float),
        ("wave_x", float, (WAVES,)),  # rad/m, wave numbers and phases (rad) of its fading over the sensor's place
        ("wave_y", float, (WAVES,)),
        ("phase", float, (WAVES,)),
        ("luck", float),  # 0 … 1, its own for ever: whether it is mirrored
    ]
)
Scatterers = NDArray[np.void]  # (N,) of SCATTERER


@dataclass(frozen=True, slots=True, eq=False)
class Sides:
    """The sides (S, 2, 2) m of things of one material, and whether each belongs to a closed outline (S,): then it faces right."""

    segments: Floats
    closed: NDArray[np.bool_]

    @property
    def lengths(self) -> Floats:
        """(S,) m."""
        along = self.segments[:, 1] - self.segments[:, 0]
        return np.hypot(along[:, 0], along[:, 1])

    @property
    def normals(self) -> Floats:
        """(S,) rad: the direction to the right of each side, which is outside where it is closed."""
        along = self.segments[:, 1] - self.segments[:, 0]
        return np.arctan2(-along[:, 0], along[:, 1])


def sides_of(things: Iterable[Thing]) -> Sides:
    """All sides of some things."""
    pieces = [(thing.segments(), thing.closed) for thing in things]
    segments = np.concatenate([np.zeros((0, 2, 2)), *(segments for segments, _ in pieces)])
    return Sides(segments, np.concatenate([np.zeros(0, dtype=bool), *(np.full(len(segments), closed) for segments, closed in pieces)]))


def points(places: Floats, rng: np.random.Generator, **columns: ArrayLike) -> Scatterers:
    """Standing scatterers at places (N, 2) m. `columns`: rcs, and whatever is not 0 or, for width, inf."""
    rows = np.zeros(len(places), dtype=SCATTERER)
    rows["x"], rows["y"], rows["width"] = places[:, 0], places[:, 1], np.inf
    for name, values in columns.items():
        rows[name] = values
    rows["wave_x"], rows["wave_y"] = rng.normal(0.0, 1.0 / ASPECT_LENGTH, (2, len(places), WAVES))
    rows["phase"] = rng.uniform(0.0, 2 * np.pi, (len(places), WAVES))
    rows["luck"] = rng.uniform(size=len(places))
    return rows


def static_scatterers(things: Sequence[Thing], rng: np.random.Generator) -> Scatterers:
    """The scatterers of all that stands, but for the mirror reflections of flat surfaces."""
    rows = [np.zeros(0, dtype=SCATTERER)]
    for material, make in ALONG_SIDES.items():
        sides = sides_of(thing for thing in things if thing.material is material)
        if len(sides.segments):
            rows.append(make(sides, rng))
    for thing in things:
        centre = thing.outline.mean(axis=0)
        if thing.material is Material.CAR:
            length, width, pose = box_around(thing.outline)
            rows.append(placed(car(length, width, rng), *pose))
        elif thing.material is Material.BUILDING and thing.closed:
            rows.append(_corners(thing.outline, rng))
        elif thing.material is Material.POLE:
            rows.append(points(centre[None], rng, rcs=rng.normal(0.0, 4.0)))
        elif thing.material is Material.TREE:
            rows.append(points(centre[None], rng, rcs=rng.normal(-6.0, 4.0), spread=0.05))
        elif thing.material in LOOSE:
            mean, count = LOOSE[thing.material]
            rows.append(_loose(thing.outline, mean, count, rng))
        elif thing.material is Material.OVERHEAD:
            rows.append(_overhead(thing, rng))
        elif thing.material in (Material.PEDESTRIAN, Material.CYCLIST):
            rows.append(placed(BODIES[thing.material](0.5, 0.5, rng), float(centre[0]), float(centre[1]), 0.0))
    return np.concatenate(rows)


LOOSE = {  # dBsm on average, and reflections, of small things without a shape worth telling
    Material.CONE: (-30.0, 1),
    Material.BARRIER: (-19.0, 4),
    Material.BICYCLE: (-12.0, 3),
    Material.PLATE: (-17.0, 1),
}


def _loose(outline: Floats, mean: float, count: int, rng: np.random.Generator) -> Scatterers:
    """Reflections anywhere between a thing's middle and its outline (N, 2)."""
    middle = outline.mean(axis=0)
    ends = outline[rng.integers(len(outline), size=count)]
    places = middle + rng.uniform(0.0, 1.0, (count, 1)) * (ends - middle)
    return points(places, rng, rcs=rng.normal(mean, 5.0, count))


def _along(sides: Sides, pitch: float, rng: np.random.Generator) -> tuple[Floats, NDArray[np.intp]]:
    """Points (N, 2) on the sides, irregularly one per `pitch` m, and the side of each."""
    expected = sides.lengths / pitch
    counts = np.floor(expected + rng.uniform(size=len(expected))).astype(np.intp)
    side = np.repeat(np.arange(len(counts)), counts)
    nth = np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (nth + rng.uniform(size=len(side))) / counts[side]
    ends = sides.segments[side]
    return ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0]), side


def _masonry(windows: float) -> Callable[[Sides, np.random.Generator], Scatterers]:
    """Rough surface, and frames, balconies, pipes or stones with a mean distance of `windows` m, each of which shows a narrow aspect."""

    def make(sides: Sides, rng: np.random.Generator) -> Scatterers:
        rough, of_rough = _along(sides, 0.5, rng)
        frames, of_frame = _along(sides, windows, rng)
        off = rng.uniform(-np.radians(60.0), np.radians(60.0), len(frames))
        behind = np.where(~sides.closed[of_frame] & (rng.uniform(size=len(frames)) < 0.5), np.pi, 0.0)  # a free-standing wall has two faces
        rough_width = np.where(sides.closed[of_rough], np.radians(50.0), np.inf)
        return np.concatenate(
            (
                points(rough, rng, rcs=rng.normal(-17.0, 3.0, len(rough)), facing=sides.normals[of_rough], width=rough_width),
                points(
                    frames,
                    rng,
                    rcs=rng.normal(1.0, 5.0, len(frames)),
                    facing=sides.normals[of_frame] + off + behind,
                    width=np.radians(rng.uniform(8.0, 30.0, len(frames))),
                ),
            )
        )

    return make


def _hedge(sides: Sides, rng: np.random.Generator) -> Scatterers:
    """Leaves and twigs: many weak reflections up to 0.8 m inside."""
    places, side = _along(sides, 0.4, rng)
    inward = sides.normals[side] + np.pi
    depth = np.where(sides.closed[side], rng.uniform(0.0, 0.8, len(side)), rng.uniform(-0.3, 0.3, len(side)))
    places = places + depth[:, None] * np.stack((np.cos(inward), np.sin(inward)), axis=-1)
    return points(places, rng, rcs=rng.normal(-13.0, 4.0, len(places)), spread=0.12)


def _fence(sides: Sides, rng: np.random.Generator) -> Scatterers:
    """Posts, and a mesh that reflects little."""
    posts, _ = _along(sides, 2.5, rng)
    mesh, _ = _along(sides, 1.0, rng)
    return np.concatenate(
        (points(posts, rng, rcs=rng.normal(-6.0, 3.0, len(posts))), points(mesh, rng, rcs=rng.normal(-20.0, 3.0, len(mesh))))
    )


def _guard_rail(sides: Sides, rng: np.random.Generator) -> Scatterers:
    """Posts at equal distances; the rail itself is a flat surface."""
    pitch = float(rng.choice((2.0, 4.0)))
    posts = [
        start + np.arange(0.0, 1.0, pitch / max(length, pitch))[:, None] * (end - start)
        for (start, end), length in zip(sides.segments, sides.lengths, strict=True)
    ]
    places = np.concatenate(posts)
    return points(places, rng, rcs=rng.normal(-1.0, 3.0, len(places)))


def _kerb(sides: Sides, rng: np.random.Generator) -> Scatterers:
    """An edge so low that it is only seen near."""
    places, _ = _along(sides, 3.0, rng)
    return points(places, rng, rcs=rng.uniform(-50.0, -34.0, len(places)))


def _corners(outline: Floats, rng: np.random.Generator) -> Scatterers:
    """A building's corners: inner ones send everything back, outer ones a little."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    inner = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] < 0
    unit_in, unit_out = (side / np.maximum(np.hypot(side[:, 0], side[:, 1]), 1e-9)[:, None] for side in (before, after))
    outward = np.stack((unit_in[:, 1] + unit_out[:, 1], -unit_in[:, 0] - unit_out[:, 0]), axis=-1)
    rcs = np.where(inner, rng.normal(10.0, 3.0, len(outline)), rng.normal(-3.0, 4.0, len(outline)))
    width = np.radians(np.where(inner, 35.0, 75.0))
    return points(outline, rng, rcs=rcs, facing=np.arctan2(outward[:, 1], outward[:, 0]), width=width)


def _overhead(thing: Thing, rng: np.random.Generator) -> Scatterers:
    """Beams, branches, lamps: some of them reflect downwards."""
    places, _ = _along(sides_of((thing,)), 2.0, rng)
    places = places[rng.uniform(size=len(places)) < 0.4]
    return points(places, rng, rcs=rng.normal(-8.0, 4.0, len(places)), height=max(thing.bottom - RADAR_HEIGHT, 0.0), spread=0.1)


ALONG_SIDES: dict[Material, Callable[[Sides, np.random.Generator], Scatterers]] = {
    Material.BUILDING: _masonry(2.0),
    Material.WALL: _masonry(4.0),
    Material.HEDGE: _hedge,
    Material.FENCE: _fence,
    Material.GUARD_RAIL: _guard_rail,
    Material.KERB: _kerb,
}


def car(length: float, width: float, rng: np.random.Generator) -> Scatterers:
    """A car about (0, 0), front towards +x: four corners, four wheel houses, four sides, uneven panels, and the way under the body."""
    x, y = length / 2, width / 2
    corners = np.array(((x, y), (-x, y), (-x, -y), (x, -y)))
    sides = np.array(((x, 0.0), (0.0, y), (-x, 0.0), (0.0, -y)))
    wheels = np.array(((0.62 * x, y), (-0.62 * x, y), (-0.62 * x, -y), (0.62 * x, -y)))
    panels, of_panel = _along(Sides(np.stack((corners, np.roll(corners, -1, axis=0)), axis=1), np.ones(4, dtype=bool)), 0.7, rng)
    clad = 10.0 * np.log10(rng.weibull(1.5, 12) + 0.02)  # dB, the spread between cars
    rows = np.concatenate(
        (
            points(corners, rng, rcs=1.0 + clad[:4], facing=np.arctan2(corners[:, 1], corners[:, 0]), width=np.radians(70.0)),
            points(wheels, rng, rcs=0.0 + clad[4:8], facing=np.sign(wheels[:, 1]) * np.pi / 2, width=np.radians(35.0)),
            points(
                sides, rng, rcs=9.0 + clad[8:], facing=np.arctan2(sides[:, 1], sides[:, 0]), width=np.radians(rng.uniform(5.0, 10.0, 4))
            ),
            points(panels, rng, rcs=rng.normal(-12.0, 3.0, len(panels)), facing=np.pi / 2 * (of_panel + 1), width=np.radians(45.0)),
            points(np.zeros((1, 2)), rng, rcs=rng.normal(-2.0, 3.0), beyond=rng.uniform(0.0, 1.0)),
        )
    )
    rows["into_x"], rows["into_y"] = -rows["x"], -rows["y"]
    return rows


def pedestrian(length: float, width: float, rng: np.random.Generator) -> Scatterers:
    """A torso and legs about (0, 0)."""
    return points(rng.uniform(-0.2, 0.2, (3, 2)), rng, rcs=rng.normal(-9.0, 2.0, 3), flutter=np.array((0.1, 1.0, 1.0)))


def cyclist(length: float, width: float, rng: np.random.Generator) -> Scatterers:
    """A frame, a torso and two wheels along x about (0, 0)."""
    places = np.stack((np.array((-0.4, -0.1, 0.1, 0.4)) * length, np.zeros(4)), axis=-1)
    return points(places, rng, rcs=rng.normal(-4.0, 3.0, 4), flutter=np.array((1.0, 0.2, 0.2, 1.0)))


BODIES = {Material.PEDESTRIAN: pedestrian, Material.CYCLIST: cyclist}


def moving_scatterers(movers: Sequence[Mover], rng: np.random.Generator) -> list[Scatterers]:
    """Each mover's scatterers in its own frame."""
    return [BODIES.get(mover.material, car)(mover.length, mover.width, rng) for mover in movers]


def placed(body: Scatterers, x: float, y: float, yaw: float, speed: float = 0.0, yaw_rate: float = 0.0) -> Scatterers:
    """A body's scatterers where it stands at (x, y, yaw), or drives with speed (m/s along yaw) and yaw rate (rad/s)."""
    rows = body.copy()
    cos, sin = np.cos(yaw), np.sin(yaw)
    arm_x, arm_y = cos * body["x"] - sin * body["y"], sin * body["x"] + cos * body["y"]
    rows["into_x"], rows["into_y"] = cos * body["into_x"] - sin * body["into_y"], sin * body["into_x"] + cos * body["into_y"]
    rows["x"], rows["y"], rows["facing"] = x + arm_x, y + arm_y, body["facing"] + yaw
    rows["vx"], rows["vy"] = speed * cos - yaw_rate * arm_y, speed * sin + yaw_rate * arm_x
    return rows


def box_around(outline: Floats) -> tuple[float, float, tuple[float, float, float]]:
    """Length, width and pose (x, y, yaw) of the box about an outline (N, 2) whose front side is along its longest side."""
    along = np.roll(outline, -1, axis=0) - outline
    longest = along[np.argmax((along**2).sum(axis=1))]
    yaw = float(np.arctan2(longest[1], longest[0]))
    cos, sin = np.cos(yaw), np.sin(yaw)
    turned = outline @ np.array(((cos, -sin), (sin, cos)))
    low, high = turned.min(axis=0), turned.max(axis=0)
    middle = (low + high) / 2
    length, width = high - low
    return float(length), float(width), (float(cos * middle[0] - sin * middle[1]), float(sin * middle[0] + cos * middle[1]), yaw)
