"""The map of mean looks against lists of what each cell was told, and beside the paper's sum."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.evidence.beams import Beams
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import MOST_LOOKS, MOST_MEASURED, STEP, TURN, UPDATES, Calibration, LookMap
from echogrid.core.map.measurement import ARRIVED
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.standstill import Standstill
from echogrid.core.map.tile import SIDE
from echogrid.core.map.tiled_map import View, probability
from echogrid.core.motion.se2 import IDENTITY, SE2

SPEC = GridSpec(cells=10, cell=0.25)
LEARNED = Calibration(1.0, 0.0)
NS = 1_000_000_000


def said(log_odds: float, weight: float = 1.0) -> np.ndarray:
    """(2, H, W), the same everywhere."""
    return np.stack([np.full((SPEC.cells, SPEC.cells), value, dtype=np.float32) for value in (log_odds, weight)])


def beams(*places: tuple[float, float]) -> Beams:
    """From a radar in the origin, a little off the borders of cells."""
    points = np.array(places, dtype=float).reshape(-1, 2)
    return Beams(points, np.zeros_like(points) + 0.01, np.ones(len(points), np.uint16))


def view(seconds: float) -> View:
    return View(round(seconds * NS), np.ones((SPEC.cells, SPEC.cells), np.uint16))


@pytest.mark.parametrize("seed", range(4))
def test_a_cell_keeps_the_weighted_mean_of_what_it_was_told(seed: int) -> None:
    """Poses that lie on the cells, so that no cell is blended: each keeps a list, and reads from it."""
    rng = np.random.default_rng(seed)
    occupancy = LookMap(SPEC, Calibration(1.7, -0.4))
    lists: dict[tuple[int, int], list[np.ndarray]] = {}
    for _ in range(20):
        row, column = rng.integers(-8, 8, 2)
        planes = np.stack((rng.normal(0, 2, (10, 10)), rng.uniform(0.05, 1, (10, 10)) ** 3)).astype(np.float32)
        occupancy.integrate(planes, SE2(column * SPEC.cell, row * SPEC.cell, 0.0))
        for i, j in np.ndindex(10, 10):
            lists.setdefault((row + i - 5, column + j - 5), []).append(planes[:, i, j])
    found = occupancy.learned(occupancy.window_of_layers(-20, -20, 40, 40))
    for i, j in np.ndindex(40, 40):
        answers = lists.get((i - 20, j - 20), [])
        expected = 1.7 * sum(z * w for z, w in answers) / sum(w for _, w in answers) - 0.4 if answers else 0.0
        assert found[i, j] == pytest.approx(expected, abs=1e-4)


def test_a_look_begins_every_half_metre_or_three_degrees() -> None:
    occupancy = LookMap(SPEC, LEARNED)
    way = [occupancy.takes(SE2(0.0, 0.0625 * n, 0.3)) for n in range(24)]  # eight updates a look, sideways
    assert way == ([True] * UPDATES + [False] * (8 - UPDATES)) * 3
    yaw = 0.3 + TURN * 1.0001
    turned = [occupancy.takes(SE2(0.0, 0.0625 * 23, yaw + TURN / 5.9999 * n)) for n in range(12)]
    assert turned == [True] * 4 + [False] * 2 + [True] * 4 + [False] * 2
    fast = [occupancy.takes(SE2(3.0 * n, 10.0, 0.0)) for n in range(9)]
    assert all(fast)
    assert (STEP, math.degrees(TURN), UPDATES) == (0.5, pytest.approx(3.0), 4)


def test_a_look_is_as_much_as_four_updates() -> None:
    """However fast the car is: layers hold sums of a quarter each."""
    occupancy = LookMap(SPEC, LEARNED)
    for _ in range(UPDATES):
        occupancy.integrate(said(2.0, 0.5), IDENTITY)
    assert occupancy.window_of_layers(0, 0, 1, 1)[:, 0, 0].tolist() == [1.0, 0.5, 0.0, 0.0, 0.0]


def test_what_is_older_than_twenty_looks_fades() -> None:
    """A wall that was taken down: the mean goes from 3 to -1 as a recursion by hand says, and never holds more than 20 looks."""
    occupancy = LookMap(SPEC, LEARNED)
    for _ in range(300):
        occupancy.integrate(said(3.0), IDENTITY)
    assert occupancy.window_of_layers(0, 0, 1, 1)[1, 0, 0] == pytest.approx(MOST_LOOKS, rel=1e-5)
    mean = 3.0
    for _ in range(200):
        occupancy.integrate(said(-1.0), IDENTITY)
        mean = (MOST_LOOKS * mean + 0.25 * -1.0) / (MOST_LOOKS + 0.25)
        assert occupancy.learned(occupancy.window_of_layers(0, 0, 1, 1))[0, 0] == pytest.approx(mean, abs=2e-3)
    assert mean < -0.6


def test_a_repeated_prior_saturates_the_sum_and_not_the_mean() -> None:
    """A network that says 0.2 of a cell it cannot see says so a hundred times: Eq. (1) takes it for a hundred witnesses."""
    total, mean = OccupancyMap(SPEC), LookMap(SPEC, LEARNED)
    for n in range(100):
        pose = SE2(0.01 * n, 0.0, 0.02 * n)
        total.integrate(said(0.2)[0], pose)
        mean.integrate(said(0.2), pose)
        if n == 9:
            early = mean.window(0, 0, 1, 1)[0, 0]
    assert total.window(0, 0, 1, 1)[0, 0] == 3.5
    assert mean.window(0, 0, 1, 1)[0, 0] == pytest.approx(early, abs=1e-3)
    assert 0 < early < 2


def test_within_a_look_a_cell_counts_once() -> None:
    """Four updates of the same reflections are one look; another is half a metre on."""
    occupancy = LookMap(SPEC, LEARNED)
    for metres in range(3):
        for update in range(UPDATES):
            pose = SE2(0.5 * metres, 0.0, 0.0)
            assert occupancy.takes(pose)
            occupancy.measure(beams((1.12, 0.12)), pose, view(metres + 0.05 * update))
            _, _, hits, near, passes = occupancy.window_of_layers(0, 0, 1, 8)[:, 0]
            assert hits[4] == pytest.approx(metres + 1)
            assert near[4] == pytest.approx(2.7 * (metres + 1))
            assert passes[:4].tolist() == [metres + 1.0] * 3 + [0.0]  # up to two cells before the reflection
            assert hits.sum() == pytest.approx(hits[4])


def test_a_look_is_four_updates_and_no_fifth() -> None:
    """The fourth alone sees one post, a fifth another: the first counts one look, the other not yet."""
    occupancy = LookMap(SPEC, LEARNED)
    for update, places in enumerate(((), (), (), ((1.12, 0.12),), ((1.12, 1.12),))):
        assert occupancy.takes(IDENTITY) == (update < UPDATES)
        occupancy.measure(beams(*places), IDENTITY, view(0.05 * update))
    assert occupancy.window_of_layers(0, 4, 5, 1)[2, :, 0].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0]


def test_what_was_measured_long_ago_fades() -> None:
    """A post that is driven past and taken away: sixty looks that passed its place outweigh any number before."""
    occupancy = LookMap(SPEC, LEARNED)

    def drive(looks: int, *places: tuple[float, float]) -> float:
        for look in range(looks):
            pose = SE2(0.0, 0.5 * (look % 2), 0.0)
            occupancy.takes(pose)
            occupancy.measure(beams(*places), pose, view(0.0))
        assert occupancy.window_of_layers(0, 0, 1, 8)[[2, 4]].sum(axis=0).max() <= MOST_MEASURED + 1e-3
        return float(occupancy.window(0, 4, 1, 1)[0, 0])

    assert drive(500, (1.12, 0.12)) > 3
    assert drive(round(8 * MOST_MEASURED), (2.12, 0.12)) < -0.5


def test_beams_are_kept_beyond_the_patch_as_far_as_the_map_reaches() -> None:
    occupancy = LookMap(SPEC, LEARNED)
    occupancy.takes(IDENTITY)
    occupancy.measure(beams((occupancy.reach - 0.1, 0.12)), IDENTITY, view(0.0))
    column = math.floor((occupancy.reach - 0.1) / SPEC.cell)
    assert occupancy.window(-8, column, 16, 1).max() > 0
    assert occupancy.window(0, 60, 1, 1)[0, 0] < 0
    seen_s, radars = occupancy.window_of_views(0, 60, 1, 1)
    assert (seen_s[0, 0], radars[0, 0]) == (1, 1)


def test_standing_for_a_minute_changes_no_cell() -> None:
    """Reflections that come and go by chance from four walls' worth of points, with an azimuth's noise."""
    rng = np.random.default_rng(3)
    occupancy = LookMap(SPEC, LEARNED)
    bearing, distance = rng.uniform(-np.pi, np.pi, 60), rng.uniform(3, 30, 60)

    def update(seconds: float) -> None:
        some = rng.uniform(size=60) < 0.4
        angle = bearing[some] + rng.normal(0, 0.01, some.sum())
        occupancy.measure(beams(*zip(distance[some] * np.cos(angle), distance[some] * np.sin(angle), strict=True)), IDENTITY, view(seconds))

    times = np.arange(1, 1200) * 0.05
    before = None
    for seconds in times:
        occupancy.takes(IDENTITY)
        update(seconds)
        if before is None and seconds > 1:
            before = probability(occupancy.window(-140, -140, 280, 280))
    assert before is not None
    assert np.abs(probability(occupancy.window(-140, -140, 280, 280)) - before).max() <= 0.05


def test_an_object_that_arrives_or_leaves_beside_a_standing_car_shows_within_three_seconds() -> None:
    occupancy = LookMap(SPEC, LEARNED)
    place, behind = (6.12, 0.12), (12.12, 0.12)

    def stand(start: float, seconds: float, *places: tuple[float, float]) -> float:
        for n in range(round(seconds / 0.05)):
            occupancy.takes(IDENTITY)
            seen = places if n % 3 == 0 else ()  # one update in three
            occupancy.measure(beams(*seen), IDENTITY, view(start + 0.05 * n))
        return float(occupancy.window(0, 24, 1, 1)[0, 0])

    assert stand(1.0, 10.0, behind) < 0
    assert stand(11.0, 3.0, place, behind) > 0
    assert stand(14.0, 20.0, place, behind) > 0
    assert stand(34.0, 3.0, behind) < 0


def test_an_arrival_counts_once_an_update_however_many_reflections_it_has() -> None:
    """Three reflections lie in one cell: four looks with a reflection and no more; of one, some lies beside it."""

    def hits(*places: tuple[float, float]) -> float:
        occupancy = LookMap(SPEC, LEARNED)
        for n in range(300):
            occupancy.takes(IDENTITY)
            occupancy.measure(beams(*(places if n > 200 else ()), (12.12, 0.12)), IDENTITY, view(1.0 + 0.05 * n))
        return float(occupancy.window_of_layers(0, 24, 1, 1)[2, 0, 0])

    assert ARRIVED / 2 < hits((6.12, 0.12)) < ARRIVED
    assert hits((6.12, 0.12), (6.13, 0.12), (6.12, 0.13)) == pytest.approx(ARRIVED)


def test_updates_of_the_same_time_make_nothing_arrive() -> None:
    standstill, place = Standstill(40, SPEC.cell), np.array([20 * 40 + 30])
    for _ in range(200):
        standstill.see(place[:0], 0.05)
    assert not any(standstill.see(place, seconds)[0].any() for seconds in [0.0] * 40 + [-3.0] * 40)
    assert any(standstill.see(place, 0.05)[0][place[0]] for _ in range(40))


def test_reflections_beside_a_cell_or_in_it_and_beams_through_it_are_measured() -> None:
    layers = np.zeros((LookMap.layers, 1, LookMap.layers), np.float32)
    layers[range(LookMap.layers), 0, range(LookMap.layers)] = 0.5
    assert LookMap(SPEC, LEARNED).measured(layers).tolist() == [[False, False, True, True, True]]


def test_standing_the_map_is_as_fresh_as_its_newest_update() -> None:
    occupancy = LookMap(SPEC, LEARNED)
    for second in range(1, 9):
        occupancy.takes(IDENTITY)
        occupancy.measure(beams((1.12, 0.12)), IDENTITY, view(second))
    assert occupancy.window_of_views(0, 0, 1, 1)[0][0, 0] == 8


def test_what_is_known_is_never_0_and_what_is_not_always_is() -> None:
    occupancy = LookMap(SPEC, LEARNED)
    assert occupancy.window(0, 0, 4, 4).tolist() == [[0.0] * 4] * 4
    assert occupancy.whole()[2].shape == (0, 0)
    occupancy.integrate(said(0.0), IDENTITY)
    assert (occupancy.window(-4, -4, 8, 8) != 0).all()


def test_the_layers_follow_a_turn() -> None:
    """A post ahead that the network knows is to the left after a left turn."""
    occupancy = LookMap(SPEC, LEARNED)
    planes = said(-1.0)
    planes[0, 4:6, 8:10] = 2.0  # x in [0.75, 1.25)
    occupancy.integrate(planes, SE2(0.0, 0.0, math.pi / 2))
    rows, columns = np.nonzero(occupancy.window_of_layers(-8, -8, 16, 16)[0] > 0.25)
    assert ((rows - 8 + 0.5) * SPEC.cell).mean() == pytest.approx(1.0, abs=0.01)
    assert ((columns - 8 + 0.5) * SPEC.cell).mean() == pytest.approx(0.0, abs=0.01)


def test_a_cell_keeps_its_place_across_tile_borders_and_tiles_left_behind_are_forgotten() -> None:
    occupancy = LookMap(SPEC, LEARNED, max_tiles=16)
    planes = said(0.0, weight=0.0)
    planes[:, 7, 2] = 1.0  # x in [-0.75, -0.5), y in [0.5, 0.75) in base
    side = SIDE * SPEC.cell
    for tile in range(-2, 40):
        occupancy.integrate(planes, SE2(tile * side, -tile * side, 0.0))
        row, column = round((0.5 - tile * side) / SPEC.cell), round((-0.75 + tile * side) / SPEC.cell)
        assert occupancy.window(row, column, 1, 1)[0, 0] > 0
    assert len(occupancy.tiles) == 16
    assert occupancy.forgotten > 20
    assert occupancy.window(round(0.5 / SPEC.cell), round(-0.75 / SPEC.cell), 1, 1)[0, 0] == 0
