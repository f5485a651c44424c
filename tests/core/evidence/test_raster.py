"""The radar image against a loop over detections, and the analytic model's rays against sampling by hand."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from echogrid.core.evidence.inverse_sensor_model import AnalyticSensorModel
from echogrid.core.evidence.raster import GridSpec, rasterize
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount

SPEC = GridSpec()


@given(arrays(float, st.tuples(st.integers(0, 30), st.just(2)), elements=st.floats(-20, 20)))
def test_drawing_equals_a_loop(points: np.ndarray) -> None:
    expected = -np.ones((1, 128, 128), dtype=np.float32)
    for x, y in points:
        row, column = math.floor((y + 15.0) / SPEC.cell), math.floor((x + 15.0) / SPEC.cell)
        if 0 <= row < 128 and 0 <= column < 128:
            expected[0, row, column] = 1.0
    np.testing.assert_array_equal(rasterize(points, SPEC), expected)


def test_left_is_a_higher_row_and_ahead_a_higher_column() -> None:
    row, column = np.argwhere(rasterize(np.array([[10.0, 5.0]]), SPEC)[0] > 0)[0]
    x, y = SPEC.centres()[row, column]
    assert abs(x - 10.0) <= SPEC.cell / 2
    assert abs(y - 5.0) <= SPEC.cell / 2
    assert row > 64
    assert column > 64


def test_the_cells_before_a_detection_are_free_and_the_cell_itself_is_occupied() -> None:
    model = AnalyticSensorModel(SPEC, [Mount(SE2(3.0, 0.0, 0.0), 1.3, 25.0)])
    log_odds = model(rasterize(np.array([[12.0, 0.1]]), SPEC))
    row = SPEC.cells // 2
    column = SPEC.locate(np.array([[12.0, 0.1]]))[0] % SPEC.cells
    assert log_odds[row, column] > 0
    assert (log_odds[row, column - 30 : column - 2] < 0).all()
    assert (log_odds[:, column + 2 :] == 0).all()  # nothing is said of what lies behind
    assert (log_odds[:, : SPEC.locate(np.array([[3.0, 0.1]]))[0] % SPEC.cells] == 0).all()  # nor behind the radar
    assert log_odds.argmax() == row * SPEC.cells + column


def test_what_two_detections_say_is_added() -> None:
    model = AnalyticSensorModel(SPEC, [Mount(SE2(3.0, 0.5, 0.5), 1.3, 25.0)])
    one, other = np.array([[10.0, 4.0]]), np.array([[12.0, 5.5]])
    both = model(rasterize(np.concatenate((one, other)), SPEC))
    np.testing.assert_allclose(both, model(rasterize(one, SPEC)) + model(rasterize(other, SPEC)), atol=1e-6)


def test_the_evidence_for_occupied_does_not_grow_with_distance() -> None:
    """The beam widens, the sum over its end stays: what is spread is one reflection."""
    model = AnalyticSensorModel(SPEC, [Mount(SE2(0.0, 0.0, 0.0), 1.3, 25.0)])
    for distance in (3.0, 8.0, 14.0):
        log_odds = model(rasterize(np.array([[distance, 0.1]]), SPEC))
        assert abs(log_odds[log_odds > 0].sum() - model.beam.occupied) < 0.35  # less where a ray passes an end cell


def test_a_patch_begins_with_its_first_cell_and_ends_before_its_far_edges() -> None:
    """Of 8 x 8 cells of half a metre: what is left of it, or ahead, is not drawn on its other side."""
    spec = GridSpec(8, 0.5)
    assert spec.locate(np.array([(-2.0, -2.0), (1.99, -2.0), (-2.0, 1.99), (1.99, 1.99)])).tolist() == [0, 7, 56, 63]
    assert spec.locate(np.array([(2.0, 0.0), (0.0, 2.0), (-2.01, 0.0), (0.0, -2.01)])).tolist() == [-1] * 4
    assert np.argwhere(rasterize(np.array([(-2.0, -2.0), (2.0, -2.0), (-2.0, 2.0)]), spec) > 0).tolist() == [[0, 0, 0]]
