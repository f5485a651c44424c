"""Maps beside annotated truth: which maps fail, and every figure against a count by hand."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.evaluation.recorded.annotated import Annotated, Asked, asked, figures, intervals, load_annotated, missed, score
from echogrid_training.evaluation.recorded.scores import Rectangle

CELL = 0.25
WHERE = Rectangle(-80, -80, 240, 400, CELL)
SLOPE = 0.3  # rad: truth's frame is turned against odom, which drifts by a metre


def street() -> Annotated:
    """60 m along x between two rows of parked cars and cones; their near faces are occupied, the road is free."""
    truth = np.zeros((80, 280), np.int8)  # y in [-10, 10), x in [-5, 65)
    truth[20:60] = -1
    boxes, kinds = [], []
    for n in range(10):
        x, size, kind = (6.0 * n, (4.5, 1.75), "vehicle.car") if n % 2 else (6.0 * n, (0.5, 0.5), "movable_object.trafficcone")
        for side in (-1, 1):
            near = side * 4.75
            far = near + side * size[1]
            boxes.append([(x + size[0], far), (x, far), (x, near), (x + size[0], near)])
            kinds.append(kind)
            row = int((near + 10) / CELL) if side > 0 else int((near + 10) / CELL) - 1
            truth[row, int((x + 5) / CELL) : int((x + 5 + size[0]) / CELL)] = 1
    poses = np.stack((np.linspace(0, 50, 251), np.zeros(251), np.zeros(251)), axis=-1)
    stamps = np.arange(251) * 40_000_000 + 1_700_000_000_000_000_000
    return Annotated(truth, np.array((-5.0, -10.0)), CELL, stamps, poses, np.array(boxes), tuple(kinds))


def driven(truth: Annotated) -> list[EgoState]:
    """Dead reckoning in a frame of its own."""
    odom_from_truth = SE2(2.0, -1.0, SLOPE)
    return [EgoState(int(t), odom_from_truth @ SE2(*pose), 5.0, 0.0) for t, pose in zip(truth.stamp_ns, truth.poses, strict=True)]


@pytest.fixture(scope="module")
def cells() -> Asked:
    truth = street()
    return asked(truth, driven(truth))


def filled(cells: Asked, occupied: float, free: float) -> np.ndarray:
    """A map that says the same of all occupied cells, and of all others."""
    out = np.full((WHERE.height, WHERE.width), free, np.float32)
    flat = WHERE.flat(cells.places)
    out.reshape(-1)[flat[cells.occupied]] = occupied
    return out


def test_the_empty_the_all_free_and_the_all_occupied_map_fail_and_a_good_one_does_not(cells: Asked) -> None:
    """A good one: all faces, a few cells of the road wrong. The yardstick is of the analytic kind: it knows little of the road."""
    rng = np.random.default_rng(1)
    good, analytic = filled(cells, 3.0, -5.0), filled(cells, 1.0, -0.1)
    wrong = rng.uniform(size=good.shape)
    good[wrong < 0.002], analytic[wrong < 0.05] = 1.0, 1.5
    yardstick = figures([score(analytic, WHERE, cells)])
    assert missed(figures([score(good, WHERE, cells)]), yardstick) == []
    empty, free, full = (missed(figures([score(np.full_like(good, value), WHERE, cells)]), yardstick) for value in (0.0, -5.0, 5.0))
    assert {"found", "free_called_free", "ap", "nll"} - {"nll"} <= set(empty)
    assert {"found", "lost", "occupied_called_free", "mse_occupied", "ap"} <= set(free)
    assert {"free_called_free", "free_called_occupied", "mse_free", "nll", "ece", "ap"} <= set(full)


def test_drift_is_not_punished_and_cells_are_where_the_car_saw_them(cells: Asked) -> None:
    """Back in truth's frame, occupied cells lie on the faces, 4.5 to 5 m beside the line; none lies where the car drove."""
    assert len(cells.objects) == 20
    back = SE2(2.0, -1.0, SLOPE).inverse().apply(cells.places)
    assert np.allclose(np.abs(back[cells.occupied, 1]), 4.875)
    along = (back[:, 0] > 0) & (back[:, 0] < 50)
    assert (np.abs(back[along, 1]) > 1.0).all()


def test_figures_are_counts(cells: Asked) -> None:
    """Half of the faces called free, the rest occupied; a tenth of the road unknown."""
    said = filled(cells, 2.0, -3.0)
    flat = WHERE.flat(cells.places)
    lost = [index for index in range(len(cells.objects)) if index % 2]
    for index in lost:
        said.reshape(-1)[flat[cells.objects[index][1]]] = -3.0
    found = figures([score(said, WHERE, cells)])
    assert found.found == pytest.approx(1 - len(lost) / len(cells.objects))
    assert found.lost == pytest.approx(len(lost) / len(cells.objects))
    occupied = WHERE.flat(cells.places[cells.occupied])
    assert found.occupied_called_free == pytest.approx((said.reshape(-1)[occupied] < 0).mean())
    assert found.free_called_free == pytest.approx(1.0, abs=1e-3)  # a cell of truth may share one of the map with a face
    assert found.mse_free == pytest.approx((np.tanh(-1.5) + 1) ** 2, abs=1e-3)
    unknown = np.where(said < 0, 0.0, said).astype(np.float32)
    assert figures([score(unknown, WHERE, cells)]).free_called_free == 0.0
    assert figures([score(unknown, WHERE, cells)]).free_called_occupied != 0.0  # of no known free cell: not a number


def test_scenes_add_up_and_intervals_hold_what_they_are_of(cells: Asked) -> None:
    one, other = (score(filled(cells, value, -3.0), WHERE, cells) for value in (2.0, -3.0))
    both, spread = figures([one, other]), intervals([one, other, one])
    assert both.found == pytest.approx((figures([one]).found + figures([other]).found) / 2)
    assert both.nll == pytest.approx((figures([one]).nll + figures([other]).nll) / 2)
    for name, value in asdict(figures([one, other, one])).items():
        assert spread[name][0] - 1e-9 <= value <= spread[name][1] + 1e-9


def test_a_file_without_truth_is_one_sentence(tmp_path: Path) -> None:
    np.savez(tmp_path / "bad.npz", truth=np.zeros((2, 2)))
    with pytest.raises(EchogridError, match=r"bad.npz: has no array 'origin'"):
        load_annotated(tmp_path / "bad.npz")
