"""Windows into blocks: against a dictionary of single cells, and what is told is what differs."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from echogrid.viewing.canvas import Canvas
from echogrid.viewing.wire import SIDE, Plane

WINDOWS = st.lists(
    st.tuples(st.integers(-70, 70), st.integers(-70, 70), st.integers(1, 50), st.integers(1, 50), st.integers(-1, 3)),
    min_size=1,
    max_size=6,
)


@given(WINDOWS)
def test_a_viewer_that_hears_every_change_knows_every_cell(windows: list[tuple[int, int, int, int, int]]) -> None:
    canvas, cells, viewer = Canvas(), {}, {}
    for number, (row, column, height, width, value) in enumerate(windows):
        window = np.full((height, width), value, np.int8)
        window[0, 0] = number
        changed = canvas.put(Plane.OCCUPANCY, row, column, window)
        before = dict(viewer)
        viewer |= changed
        assert all(not np.array_equal(before.get(key, np.full((SIDE, SIDE), -1)), block) for key, block in changed.items())
        cells |= {(row + i, column + j): window[i, j] for i in range(height) for j in range(width)}
    for (i, j), value in cells.items():
        block = viewer.get((i // SIDE, j // SIDE))
        assert (-1 if block is None else block[i % SIDE, j % SIDE]) == value
    known = sum(int((block != -1).sum()) for block in viewer.values())
    assert known == sum(value != -1 for value in cells.values())


def test_what_is_the_same_is_not_told_again_and_far_away_is_forgotten() -> None:
    canvas, window = Canvas(), np.arange(64 * 64, dtype=np.int64).reshape(64, 64) % 100
    assert len(canvas.put(Plane.OCCUPANCY, 0, 0, window)) == 4
    assert canvas.put(Plane.OCCUPANCY, 0, 0, window) == {}
    window[40, 3] += 1
    assert list(canvas.put(Plane.OCCUPANCY, 0, 0, window)) == [(1, 0)]
    canvas.put(Plane.TRUTH, 0, 0, window)
    canvas.put(Plane.OCCUPANCY, 1000, 1000, window)
    canvas.keep_near(1000, 1000, 200)
    assert {key[0] // 10 for key in canvas.planes[Plane.OCCUPANCY]} == {3}
    assert len(canvas.planes[Plane.TRUTH]) == 4
    canvas.clear()
    assert (len(canvas.planes[Plane.OCCUPANCY]), len(canvas.planes[Plane.TRUTH])) == (0, 4)
