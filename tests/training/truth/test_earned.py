"""What radars can have earned, against a walk along every line of sight."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.evidence.history import Detections, Looks, Surroundings
from echogrid.core.evidence.raster import GridSpec
from echogrid_training.truth.earned import BESIDE, earned

SPEC = GridSpec()
CELLS = SPEC.centres()


def around(places: list[tuple[float, float, float]], half_fov: float = math.pi, reach: float = 40.0, points: object = ()) -> Surroundings:
    """Looks from places (x, y, yaw), and detections at points."""
    count = len(places)
    found = np.array(points, dtype=float).reshape(-1, 2)
    past = Detections(found, np.zeros_like(found), np.zeros(len(found)), np.zeros(len(found)))
    looks = Looks(np.array(places, dtype=float), np.full(count, half_fov), np.full(count, reach))
    return Surroundings(past, past, np.zeros(len(found)), np.zeros(len(found), dtype=np.int64), looks, ())


def walls(seed: int) -> np.ndarray:
    """A true patch: free, with some short walls and posts."""
    rng = np.random.default_rng(seed)
    truth = np.full((SPEC.cells, SPEC.cells), -4.0, dtype=np.float32)
    for row, column in rng.integers(8, SPEC.cells - 20, (14, 2)):
        long = int(rng.integers(1, 12))
        if rng.uniform() < 0.5:
            truth[row : row + long, column : column + 2] = 4.0
        else:
            truth[row : row + 2, column : column + long] = 4.0
    truth[np.hypot(CELLS[..., 0], CELLS[..., 1]) < 2.0] = -4.0
    return truth


def walked(truth: np.ndarray, place: tuple[float, float], goal: np.ndarray, step: float = 0.05) -> float:
    """m of occupied cells on the way from a place to shortly before a goal."""
    way = goal - place
    far = float(np.hypot(*way))
    along = np.arange(0.0, max(far - 1.5 * SPEC.cell, 0.0), step)
    cells = SPEC.locate(np.asarray(place) + along[:, None] * way / far)
    return step * float((truth.reshape(-1)[cells[cells >= 0]] > 0).sum())


def test_what_is_in_free_sight_is_earned_and_what_is_behind_is_not() -> None:
    """Apart from the edges of shadows: cells whose neighbours half a metre away are not all as they are."""
    checked = {True: 0, False: 0}
    around_it = np.array(((0.0, 0.0), (0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5)))
    for seed in range(3):
        truth, place = walls(seed), (0.3, -0.4)
        seen = earned(truth, around([(*place, 0.0)]), SPEC)
        for row, column in np.random.default_rng(seed).integers(3, SPEC.cells - 3, (500, 2)):
            if (truth[row - 3 : row + 4, column - 3 : column + 4] > 0).any():
                continue
            crossed = [walked(truth, place, CELLS[row, column] + off) for off in around_it]
            if max(crossed) == 0.0 or min(crossed) > 0.2:
                assert seen[row, column] == (max(crossed) == 0.0), (seed, row, column)
                checked[bool(seen[row, column])] += 1
    assert min(checked.values()) > 100


def test_the_faces_that_hide_are_earned_themselves() -> None:
    truth = np.full((SPEC.cells, SPEC.cells), -4.0, dtype=np.float32)
    truth[40:90, 100] = 4.0  # a wall ahead
    truth[40:90, 104] = 4.0  # and another one behind it
    seen = earned(truth, around([(0.0, 0.0, 0.0)]), SPEC)
    assert seen[45:85, 100].all()
    assert not seen[45:85, 104].any()


def test_no_radar_earns_what_it_never_looked_at_unless_it_detected_something_there() -> None:
    truth = np.full((SPEC.cells, SPEC.cells), -4.0, dtype=np.float32)
    ahead = around([(1.0, 0.0, 0.0)], half_fov=math.radians(60.0), reach=8.0, points=((-9.0, 3.0),))
    seen = earned(truth, ahead, SPEC)
    off = np.abs(np.arctan2(CELLS[..., 1], CELLS[..., 0] - 1.0))
    far = np.hypot(CELLS[..., 0] - 1.0, CELLS[..., 1])
    hit = SPEC.locate(np.array(((-9.0, 3.0),)))[0]
    row, column = divmod(int(hit), SPEC.cells)
    beside = np.zeros_like(seen)
    beside[row - BESIDE : row + BESIDE + 1, column - BESIDE : column + BESIDE + 1] = True
    assert seen[(off < math.radians(57.0)) & (far < 7.5) & (far > 2.0)].all()
    assert not seen[((off > math.radians(70.0)) | (far > 8.5)) & (far > 0.5) & ~beside].any()
    assert seen[beside].all()


@pytest.mark.parametrize("yaw_deg", [130.0, 170.0, -170.0])
def test_a_radar_that_is_turned_looks_where_it_is_turned_to(yaw_deg: float) -> None:
    """To the left and behind, by its own bearing of each cell."""
    truth, yaw, half = np.full((SPEC.cells, SPEC.cells), -4.0, dtype=np.float32), math.radians(yaw_deg), math.radians(30.0)
    seen = earned(truth, around([(0.5, 0.2, yaw)], half_fov=half, reach=9.0), SPEC)
    x, y = CELLS[..., 0] - 0.5, CELLS[..., 1] - 0.2
    along, across = x * math.cos(yaw) + y * math.sin(yaw), -x * math.sin(yaw) + y * math.cos(yaw)  # in the radar's own frame
    inside = (np.hypot(along, across) < 8.5) & (np.hypot(along, across) > 2.0)
    assert seen[inside & (along > 0) & (np.abs(across) < along * math.tan(half - 0.09))].all()
    assert not seen[inside & ((along < 0) | (np.abs(across) > np.abs(along) * math.tan(half + 0.2)))].any()
    assert seen.sum() > 300


def test_evidence_hides_by_its_sign_and_what_is_unknown_hides_nothing() -> None:
    truth, look = walls(0), around([(0.3, -0.4, 0.0)])
    assert (earned(np.where(truth > 0, np.float32(0.3), np.float32(0.0)), look, SPEC) == earned(truth, look, SPEC)).all()


def test_what_any_look_saw_is_earned() -> None:
    """Of more looks than are tried, the first and the last are among those that are."""
    truth, places = walls(1), [(0.3, -0.4, 0.0), (-6.0, 1.0, 0.4), (4.0, 7.0, -1.0)]
    alone = [earned(truth, around([place]), SPEC) for place in places]
    assert (earned(truth, around(places), SPEC) == alone[0] | alone[1] | alone[2]).all()
    assert not (alone[0] == alone[1]).all()
    far_off = (200.0, 0.0, 0.0)
    many = earned(truth, around([places[0], *[far_off] * 60, places[1]]), SPEC)
    assert (many == alone[0] | alone[1]).all()


def test_a_shadow_is_as_wide_as_what_casts_it() -> None:
    """A wall half a metre ahead has no gaps; a post's shadow behind it grows with the distance."""
    truth = np.full((SPEC.cells, SPEC.cells), -4.0, dtype=np.float32)
    truth[:, SPEC.cells // 2 + 2] = 4.0
    assert not earned(truth, around([(0.0, 0.0, 0.0)]), SPEC)[40:88, SPEC.cells // 2 + 6 :].any()
    truth[:] = -4.0
    row, column = divmod(int(SPEC.locate(np.array(((5.0, 0.1),)))[0]), SPEC.cells)
    truth[row, column] = 4.0
    shadow = (~earned(truth, around([(0.0, 0.0, 0.0)]), SPEC)).sum() * SPEC.cell**2
    assert shadow == pytest.approx(SPEC.cell / 5.0 * (15.0**2 - 5.0**2) / 2.0, rel=0.4)


def test_a_detection_in_the_first_corner_of_the_patch_counts() -> None:
    truth = np.full((SPEC.cells, SPEC.cells), -4.0, dtype=np.float32)
    seen = earned(truth, around([(0.0, 0.0, 0.0)], reach=1.0, points=(CELLS[0, 0],)), SPEC)
    assert seen[: BESIDE + 1, : BESIDE + 1].all()
    assert seen[CELLS[..., 0] < -10.0].sum() == (BESIDE + 1) ** 2
