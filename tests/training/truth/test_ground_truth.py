"""The true map against a slow sum over cells, and what has to be left out of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.support.tiny_towns import box, car_mover, line, room, street, town, track

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid.logs.drive import load_truth
from echogrid_training.drives.drive import write_drive
from echogrid_training.drives.simulate import from_first_pose, lidar_turns, simulate, truth_map
from echogrid_training.sensors.episode import paper_like
from echogrid_training.sensors.lidar import AZIMUTHS
from echogrid_training.towns.town import Material
from echogrid_training.truth.ground_truth import CLAMP, HIT, PASS, REACH, TruthBuilder, TruthMap, soft, ternary

SPEC = GridSpec()


def test_the_sum_is_that_of_a_slow_reference() -> None:
    """Eq. (1), cell by cell: the log-odds of every turn are added, and kept within the clamp after each.

    From one place, then from places around it: some cells come to either end of the clamp, and some back from there.
    """
    rng = np.random.default_rng(0)
    places = np.concatenate((np.full((6, 2), (0.4, -0.7)), rng.uniform(-2.0, 2.0, (12, 2))))
    far = np.concatenate((np.full(6, 6.5), rng.uniform(6.0, 9.0, 12)))
    turns = [np.where(rng.uniform(size=AZIMUTHS) < 0.1, np.inf, one + rng.normal(0, 0.02, AZIMUTHS)) for one in far]
    builder = TruthBuilder(places.min(axis=0), places.max(axis=0))
    nobody = np.zeros(AZIMUTHS, dtype=bool)
    for place, ranges in zip(places, turns, strict=True):
        builder.add(place, ranges, nobody)
    found = builder.finish()

    angles = np.arange(0.0, 2 * np.pi, 0.5)  # and where the first six turns have a surface
    surface = np.floor((places[0] + 6.5 * np.stack((np.cos(angles), np.sin(angles)), axis=1)) / SPEC.cell).astype(int)
    cells = [(row, column) for row in range(-40, 41, 8) for column in range(-38, 39, 7)] + surface[:, ::-1].tolist()
    ends = {"low": 0, "high": 0, "back": 0}
    for row, column in cells:
        total, plain = 0.0, 0.0
        x, y = (column + 0.5) * SPEC.cell, (row + 0.5) * SPEC.cell
        for place, ranges in zip(places, turns, strict=True):
            added = one_turn(place, ranges, row, column, x, y)
            total, plain = min(max(total + added, -CLAMP), CLAMP), plain + added
            ends["high"] += plain > total == CLAMP
        ends["low"] += total == -CLAMP > plain
        ends["back"] += abs(total) < CLAMP and total != plain
        i, j = (round((row * SPEC.cell - found.origin[1]) / SPEC.cell), round((column * SPEC.cell - found.origin[0]) / SPEC.cell))
        assert math.isclose(found.log_odds[i, j], total, abs_tol=1e-5), (row, column)
    assert min(ends.values()) >= 1, ends


def one_turn(place: np.ndarray, ranges: np.ndarray, row: int, column: int, x: float, y: float) -> float:
    for ray, range_ in enumerate(ranges.tolist()):
        if range_ < REACH:
            angle = 2 * math.pi * ray / AZIMUTHS
            hit_x, hit_y = place[0] + range_ * math.cos(angle), place[1] + range_ * math.sin(angle)
            if math.floor(hit_x / SPEC.cell) == column and math.floor(hit_y / SPEC.cell) == row:
                return HIT
    ray = round(math.atan2(y - place[1], x - place[0]) * AZIMUTHS / (2 * math.pi))
    before = [min(ranges[(ray + step) % AZIMUTHS], REACH) for step in (-1, 0, 1)]  # without a return it saw the ground all the way
    distance = math.dist((x, y), place)
    return PASS if all(distance < range_ - SPEC.cell / 2 for range_ in before) else 0.0


def test_movers_leave_no_occupied_cells() -> None:
    """A car overtakes in a room; the map has the room's walls and nothing else, and the cells it passed are free."""
    passing = car_mover(track(4.0, speed=4.0, x=-8.0, y=3.5))
    standing = car_mover(track(4.0, x=4.0, y=-4.0))
    with_traffic = truth_map(list(lidar_turns(town(*room(), movers=(passing, standing), ego=track(4.0)))))
    empty = truth_map(list(lidar_turns(town(*room(), ego=track(4.0)))))
    one, other = with_traffic.patch(IDENTITY, SPEC), empty.patch(IDENTITY, SPEC)
    assert (other[one > 0] > 0).all()
    behind = SPEC.centres()
    under_standing = (np.abs(behind[..., 0] - 4.0) < 1.5) & (np.abs(behind[..., 1] + 4.0) < 0.5)
    assert (one[under_standing] == 0).all()  # what stands there all the time hides it
    under_passing = (np.abs(behind[..., 0]) < 6.0) & (np.abs(behind[..., 1] - 3.5) < 0.5)
    assert (one[under_passing] < 0).all()


def test_rows_are_y_and_columns_are_x_of_the_car() -> None:
    """A pole ahead to the left of a car that looks north."""
    pole, far = box(Material.POLE, -3.0, 8.0, 0.4, 0.4), line(Material.BUILDING, (-25.0, 25.0), (25.0, 25.0))
    looking_north = town(pole, far, ego=track(1.0, yaw=math.pi / 2))
    seen = truth_map(list(lidar_turns(from_first_pose(looking_north)))).patch(IDENTITY, SPEC)
    row, column = np.argwhere(seen > 0).mean(axis=0)
    assert (column + 0.5) * SPEC.cell - SPEC.half == pytest.approx(8.0, abs=0.3)
    assert (row + 0.5) * SPEC.cell - SPEC.half == pytest.approx(3.0, abs=0.3)


def test_a_patch_reads_the_cell_under_each_of_its_centres() -> None:
    """Against a loop, at a pose that is turned and partly beyond the map."""
    rng = np.random.default_rng(1)
    truth = TruthMap(rng.normal(size=(90, 70)).astype(np.float32), (-3 * SPEC.cell, 5 * SPEC.cell), SPEC.cell)
    pose = SE2(4.0, 9.0, 2.2)
    patch = truth.patch(pose, SPEC)
    for i in range(0, 128, 7):
        for j in range(0, 128, 7):
            (point,) = pose.apply(SPEC.centres()[i, j][None])
            row, column = (
                math.floor((value - start) / SPEC.cell) for value, start in ((point[1], truth.origin[1]), (point[0], truth.origin[0]))
            )
            inside = 0 <= row < 90 and 0 <= column < 70
            assert patch[i, j] == (truth.log_odds[row, column] if inside else 0.0)


def test_labels() -> None:
    log_odds = np.array((-4.0, 0.0, np.finfo(np.float32).tiny, 3.0), dtype=np.float32)
    assert ternary(log_odds).tolist() == [-1, 0, 1, 1]
    np.testing.assert_allclose(soft(log_odds), np.tanh(log_odds / 2))
    ones = np.array(((1.0, 0.0, -0.5),), dtype=np.float32)
    assert TruthMap(ones, (0.0, 0.0), SPEC.cell).observed.tolist() == [[True, False, True]]


def test_evidence_that_cancels_is_still_seen() -> None:
    builder = TruthBuilder(np.zeros(2), np.zeros(2))
    wall = np.full(AZIMUTHS, 6.0)
    builder.add(np.zeros(2), wall, np.zeros(AZIMUTHS, dtype=bool))
    for _ in range(4):
        builder.add(np.zeros(2), np.full(AZIMUTHS, 12.0), np.zeros(AZIMUTHS, dtype=bool))
    truth = builder.finish()
    cancelled = (truth.log_odds > 0) & (truth.log_odds < 1e-20)
    assert cancelled.any()
    assert truth.observed[cancelled].all()


def test_a_typical_street_has_a_few_percent_of_occupied_pixels() -> None:
    seconds = 4.0
    truth = truth_map(list(lidar_turns(street(seconds))))
    shares = [(truth.patch(SE2(8.0 * time, 0.0, 0.0), SPEC) > 0).mean() for time in np.arange(0.0, seconds)]
    assert 0.02 < np.mean(shares) < 0.045


def test_a_drive_folder_keeps_the_map_beside_the_poses(tmp_path: Path) -> None:
    recording, truth = simulate(town(*room(), ego=track(0.5)), paper_like())
    write_drive(recording, tmp_path / "drive", truth_map=truth)
    with np.load(tmp_path / "drive" / "truth.npz") as file:
        read = TruthMap(file["log_odds"], (float(file["origin"][0]), float(file["origin"][1])), float(file["cell"]))
    np.testing.assert_array_equal(read.log_odds, truth.log_odds)
    assert (read.origin, read.cell) == (truth.origin, truth.cell)
    poses = load_truth(tmp_path / "drive" / "truth.npz")
    assert poses is not None
    assert len(poses.stamp_ns) == 51
