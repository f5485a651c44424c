"""What is remembered of the last metres, against points worked out by hand and against itself from elsewhere."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.evidence.history import LENGTH, MOST_UPDATES, Detections, History, Looks, _Rows
from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid.core.radar.mount import Mount

CORNER = Mount(SE2(3.7, 0.8, math.radians(45)), math.radians(75), 25.0)
NOWHERE = Looks.of([], [])
poses = st.builds(SE2, st.floats(-50, 50), st.floats(-50, 50), st.floats(-7, 7))


def detections(points: np.ndarray, origin: tuple[float, float] = (0.0, 0.0)) -> Detections:
    """Each with a cross-section and a deviation that tell it from the others."""
    number = np.arange(len(points), dtype=float)
    return Detections(points, np.tile(origin, (len(points), 1)).astype(float), number - 20, number / 10)


def moved(found: Detections, to_from_here: SE2) -> Detections:
    """Into another frame."""
    return Detections(to_from_here.apply(found.points), to_from_here.apply(found.origins), found.rcs, found.deviation)


def one(x: float, y: float) -> Detections:
    return detections(np.array([(x, y)]))


@given(poses, poses, poses, st.integers(0, 99))
def test_what_stands_in_odom_is_the_same_wherever_it_was_seen_from(here: SE2, there: SE2, last: SE2, seed: int) -> None:
    """Seen from two poses or from one, a world that stands looks the same from a third."""
    rng = np.random.default_rng(seed)
    first, second = (detections(rng.uniform(-60, 60, (count, 2)), (1.0, 2.0)) for count in (4, 3))  # in odom
    looked = SE2(3.0, -2.0, 0.7)  # in odom
    seen = []
    for at in (here, there):
        history = History()
        history.add(moved(moved(first, at.inverse()), at), Looks.of([CORNER], [at @ (at.inverse() @ looked)]), 0.0)
        history.add(moved(moved(second, last.inverse()), last), Looks.of([CORNER], [looked]), 1.0)
        seen.append(history.surroundings(last, ()))
    for key in ("points", "origins", "rcs", "deviation"):
        np.testing.assert_allclose(getattr(seen[0].past, key), getattr(seen[1].past, key), atol=1e-9)
    np.testing.assert_allclose(seen[0].looks.place, seen[1].looks.place, atol=1e-9)
    np.testing.assert_allclose(last.apply(seen[0].past.points), np.concatenate((first.points, second.points)), atol=1e-9)
    np.testing.assert_allclose(seen[0].now.points, last.inverse().apply(second.points), atol=1e-9)


def test_a_straight_drive_by_hand() -> None:
    """Up odom's y axis, a metre an update, past a post at (-3, 10): from the fourth metre it is 6 m ahead and 3 m to the left."""
    history = History()
    for k in range(5):
        there = SE2(0.0, float(k), math.pi / 2)
        history.add(moved(detections(np.array([(10.0 - k, 3.0)]), (3.7, 0.8)), there), Looks.of([CORNER], [there]), float(k))
    around = history.surroundings(SE2(0.0, 4.0, math.pi / 2), ["front_left"])
    np.testing.assert_allclose(around.past.points, [(6.0, 3.0)] * 5, atol=1e-12)
    np.testing.assert_allclose(around.past.origins, [(-0.3, 0.8), (0.7, 0.8), (1.7, 0.8), (2.7, 0.8), (3.7, 0.8)], atol=1e-12)
    np.testing.assert_allclose(around.now.points, [(6.0, 3.0)], atol=1e-12)
    np.testing.assert_allclose(around.now.origins, [(3.7, 0.8)], atol=1e-12)
    assert around.age.tolist() == [4.0, 3.0, 2.0, 1.0, 0.0]
    assert around.update.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(around.looks.place[:, :2], around.past.origins, atol=1e-12)
    np.testing.assert_allclose(around.looks.place[:, 2], math.radians(45), atol=1e-12)
    assert around.looks.half_fov.tolist() == [math.radians(75)] * 5
    assert around.looks.max_range.tolist() == [25.0] * 5
    assert around.live == ["front_left"]


def test_each_detection_keeps_what_is_its_own() -> None:
    """Ages and updates go with the detections, however many an update has; none is no exception."""
    history = History()
    for k, count in enumerate((2, 0, 3)):
        history.add(detections(np.full((count, 2), float(k))), NOWHERE, 0.5 * k)
    around = history.surroundings(IDENTITY, ())
    assert around.past.points[:, 0].tolist() == [0.0, 0.0, 2.0, 2.0, 2.0]
    assert around.past.rcs.tolist() == [-20.0, -19.0, -20.0, -19.0, -18.0]
    assert around.past.deviation.tolist() == [0.0, 0.1, 0.0, 0.1, 0.2]
    assert around.age.tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert around.update.tolist() == [0, 0, 2, 2, 2]
    assert len(around.now) == 3
    assert around.looks.place.shape == (0, 3)


def test_it_is_the_way_that_counts() -> None:
    """Eight updates a metre or one every 4 m: what lies more than 15 m of way back is gone, and nothing else."""
    for step, expected in ((0.125, 121), (4.0, 4)):
        history = History()
        for k in range(200):
            history.add(one(0.0, 0.0), NOWHERE, k * step)
        around = history.surroundings(IDENTITY, ())
        assert len(around.past) == expected
        assert LENGTH - step < around.age.max() <= LENGTH


def test_time_and_place_make_nothing_old() -> None:
    """Reversing out of a dead end: way is made though the place is the same; standing, none is made."""
    history = History()
    for _ in range(100):
        history.add(one(0.0, 0.0), NOWHERE, 3.0)
    assert len(history.surroundings(IDENTITY, ()).past) == 100
    history.add(one(0.0, 0.0), NOWHERE, 3.0 + LENGTH + 0.1)
    assert len(history.surroundings(IDENTITY, ()).past) == 1


def test_on_a_turntable_memory_is_bounded() -> None:
    history = History()
    for k in range(3 * MOST_UPDATES):
        turned = SE2(0.0, 0.0, 0.1 * k)
        history.add(moved(one(5.0, 0.0), turned), Looks.of([CORNER], [turned]), 0.0)
    around = history.surroundings(SE2(0.0, 0.0, 0.1 * (3 * MOST_UPDATES - 1)), ())
    assert len(around.past) == len(around.looks.place) == MOST_UPDATES == 160
    assert around.update.tolist() == list(range(2 * MOST_UPDATES, 3 * MOST_UPDATES))
    bearing = np.arctan2(around.past.points[:, 1], around.past.points[:, 0])
    np.testing.assert_allclose(np.exp(1j * bearing), np.exp(-0.1j * np.arange(MOST_UPDATES)[::-1]), atol=1e-9)


@given(st.lists(poses, min_size=1, max_size=4))
def test_looks_are_from_where_the_sensor_was(bases: list[SE2]) -> None:
    """The sensor's own position and a point ahead of it, carried along one after the other."""
    mounts = [CORNER] * len(bases)
    looks = Looks.of(mounts, bases)
    for place, base in zip(looks.place, bases, strict=True):
        corner = base.apply(np.array([(3.7, 0.8), (3.7 + math.cos(math.radians(45)), 0.8 + math.sin(math.radians(45)))]))
        np.testing.assert_allclose(place[:2], corner[0], atol=1e-9)
        np.testing.assert_allclose((np.cos(place[2]), np.sin(place[2])), corner[1] - corner[0], atol=1e-9)


@given(poses, poses)
def test_looks_that_are_remembered_are_the_moved_sensors(base: SE2, to_from_here: SE2) -> None:
    sensor = to_from_here @ (base @ CORNER.base_from_sensor)
    history = History()
    history.add(one(0.0, 0.0), Looks.of([CORNER], [base]), 0.0)
    (found,) = history.surroundings(to_from_here.inverse(), ()).looks.place
    np.testing.assert_allclose(found[:2], (sensor.x, sensor.y), atol=1e-9)
    assert abs(math.remainder(found[2] - sensor.yaw, math.tau)) < 1e-9


@given(st.lists(st.tuples(st.integers(0, 300), st.integers(0, 300)), max_size=12))
def test_rows_are_those_that_were_added_and_not_dropped(steps: list[tuple[int, int]]) -> None:
    rows, kept, count = _Rows((2,), ()), list[int](), 0
    for more, fewer in steps:
        added = np.arange(count, count + more, dtype=float)
        rows.add(more, np.stack((added, -added), axis=1), added)
        kept += range(count, count + more)
        count += more
        fewer = min(fewer, len(kept))
        rows.drop(fewer)
        kept = kept[fewer:]
        pairs, numbers = rows.rows()
        assert numbers.tolist() == kept
        assert pairs.tolist() == [[number, -number] for number in kept]
