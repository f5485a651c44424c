"""The lidar against rooms whose walls are known."""

from __future__ import annotations

import math

import numpy as np
from tests.support.tiny_towns import box, line, room, town, track

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.motion.se2 import IDENTITY
from echogrid_training.drives.simulate import lidar_turns, truth_map
from echogrid_training.sensors.lidar import AZIMUTHS, BEAMS, GROUND, HEIGHT, ROOF, Surfaces, bearings, reduce, turn
from echogrid_training.towns.town import Material, Thing
from echogrid_training.truth.ground_truth import ternary

ORIGIN = np.array((1.35, 0.0))


def surfaces(*things: Thing) -> Surfaces:
    sides = [thing.segments() for thing in things]
    counts = [len(side) for side in sides]
    bottom, top = np.array([thing.bottom for thing in things]), np.array([thing.top for thing in things])
    return Surfaces(np.concatenate([np.zeros((0, 2, 2)), *sides]), np.repeat(bottom, counts), np.repeat(top, counts))


def to_walls(bearing: np.ndarray, x: float, y: float) -> np.ndarray:
    """From ORIGIN to the walls at ±x and ±y, by the rule of the rectangle."""
    cos, sin = np.cos(bearing), np.sin(bearing)
    with np.errstate(divide="ignore"):
        return np.minimum((np.copysign(x, cos) - ORIGIN[0]) / cos, np.abs(y / sin))


def test_the_ranges_of_a_room_are_those_to_its_walls() -> None:
    ranges, surface = reduce(turn(surfaces(*room(24.0, 16.0)), ORIGIN))
    np.testing.assert_allclose(ranges, to_walls(bearings(), 12.0, 8.0), rtol=1e-9)
    assert set(surface.tolist()) == {0, 1, 2, 3}


def test_every_return_is_a_surface_or_the_ground() -> None:
    """By triangles: a beam's height at the distance where it ends is that of the ground, or between those of the surface."""
    seen = turn(surfaces(*room(24.0, 16.0)), ORIGIN)
    back = np.isfinite(seen.distance)
    np.testing.assert_allclose(seen.height[back], np.broadcast_to(HEIGHT + seen.distance * np.tan(BEAMS), back.shape)[back], atol=1e-9)
    ground = back & (seen.surface < 0)
    assert ground.any()
    np.testing.assert_allclose(seen.height[ground], 0.0)
    assert (seen.distance[ground] <= np.broadcast_to(to_walls(bearings(), 12.0, 8.0)[:, None], ground.shape)[ground]).all()
    assert ((seen.height[back & ~ground] >= 0) & (seen.height[back & ~ground] <= 3.0)).all()


def test_ground_and_kerbs_are_removed() -> None:
    empty, _ = reduce(turn(surfaces(), ORIGIN))
    assert np.isinf(empty).all()
    kerb = line(Material.KERB, (-20.0, 5.0), (20.0, 5.0), top=0.15)
    seen = turn(surfaces(kerb), ORIGIN)
    assert (seen.surface == 0).any()  # it does come back
    assert (seen.height[seen.surface == 0] < GROUND).all()
    assert np.isinf(reduce(seen)[0]).all()


def test_what_is_overhead_does_not_end_a_ray() -> None:
    bridge, wall = box(Material.OVERHEAD, 6.0, 0.0, 3.0, 40.0, top=6.0, bottom=ROOF + 0.5), room(24.0, 16.0)
    ranges, _ = reduce(turn(surfaces(bridge, *wall), ORIGIN))
    np.testing.assert_allclose(ranges, to_walls(bearings(), 12.0, 8.0), rtol=1e-9)


def test_low_things_hide_what_is_behind_them_only_from_the_reduced_scan() -> None:
    """Over a garden wall the house is seen, but the nearest return is the wall's."""
    low, house = line(Material.WALL, (-20.0, 6.0), (20.0, 6.0), top=0.8), line(Material.BUILDING, (-20.0, 9.0), (20.0, 9.0), top=8.0)
    seen = turn(surfaces(low, house), ORIGIN)
    left = AZIMUTHS // 4
    assert set(seen.surface[left].tolist()) == {-1, 0, 1}
    assert reduce(seen)[0][left] == 6.0


def test_the_map_of_a_room_is_the_room() -> None:
    """Every wall cell occupied, every cell inside free, nothing beyond; walls between cells' borders, so that the cells are known."""
    spec = GridSpec()
    x, y = 50.5 * spec.cell, 33.5 * spec.cell
    found = ternary(truth_map(list(lidar_turns(town(*room(2 * x, 2 * y), ego=track(2.0))))).patch(IDENTITY, spec))
    centres = np.abs(spec.centres())
    inside = (centres[..., 0] < x - spec.cell / 2) & (centres[..., 1] < y - spec.cell / 2)
    outside = (centres[..., 0] > x + spec.cell / 2) | (centres[..., 1] > y + spec.cell / 2)
    walls = ~inside & ~outside
    corners = walls & (centres[..., 0] > x - spec.cell / 2) & (centres[..., 1] > y - spec.cell / 2)
    assert (found[walls & ~corners] == 1).mean() > 0.99
    assert (found[walls] >= 0).all()
    assert (found[outside] == 0).all()
    near_wall = inside & ((centres[..., 0] > x - 1.5 * spec.cell) | (centres[..., 1] > y - 1.5 * spec.cell))
    assert (found[inside & ~near_wall] == -1).all()
    assert (found[near_wall] <= 0).all()


def test_the_map_is_free_under_a_bridge() -> None:
    spec = GridSpec()
    bridge = box(Material.OVERHEAD, 4.0, 0.0, 2.0, 14.0, top=6.0, bottom=2.5)
    with_bridge = truth_map(list(lidar_turns(town(bridge, *room(24.0, 16.0), ego=track(1.0))))).patch(IDENTITY, spec)
    without = truth_map(list(lidar_turns(town(*room(24.0, 16.0), ego=track(1.0))))).patch(IDENTITY, spec)
    np.testing.assert_array_equal(with_bridge, without)
    assert math.isclose(with_bridge[64, 64 + int(4.0 / spec.cell)], -5.0)
