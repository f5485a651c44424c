"""What lies about a cell."""

from __future__ import annotations

import pytest

from echogrid.core.map.standstill import disc


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.5, 4.7])
def test_a_disc_is_all_cells_whose_centres_are_within_it(radius: float) -> None:
    size = 32
    expected = {row * size + column for row in range(-9, 10) for column in range(-9, 10) if row**2 + column**2 <= radius**2}
    assert set(disc(radius, size).tolist()) == expected
    assert len(disc(radius, size)) == len(expected)
