"""What `map info` counts, against the map's own cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.stores import CELL, NAMES, random_tiles, window

from echogrid.maps.info import info, lines


def test_info_counts_what_is_there(stored: Path) -> None:
    found = info(stored)
    assert (found["version"], [epoch["epoch"] for epoch in found["epochs"]]) == (2, [1, 3])  # an epoch without tiles goes with the next
    for epoch in found["epochs"]:
        log_odds, origin = window(stored, epoch["epoch"])
        assert epoch["known_cells"] == np.count_nonzero(log_odds)
        assert epoch["area_m2"] == pytest.approx(np.count_nonzero(log_odds) * 0.0625, abs=1e-3)
        height, width = log_odds.shape
        assert epoch["bounds_m"] == [*origin, origin[0] + width * CELL, origin[1] + height * CELL]
        seen_s = np.concatenate([tile.seen_s[tile.seen_s > 0] for tile in random_tiles(2, kind="looks").values()])
        assert (epoch["tiles"], epoch["radars"], epoch["cell_m"], epoch["vehicle"]) == (3, list(NAMES), CELL, "car")
        if epoch["kind"] == "looks":
            assert (epoch["oldest_s"], epoch["newest_s"]) == (seen_s.min(), seen_s.max())
            assert 0 < epoch["measured_cells"] < epoch["known_cells"]
    text_ = "\n".join(lines(found, 1_700_007_200.0))
    assert "epoch 3: vehicle 'car', started 2023-11-14 22:13:20 UTC" in text_
    assert "(2 h ago)" in text_
    before = "\n".join(lines(found, found["epochs"][0]["newest_s"] - 1800.0))  # the clock was set back since
    assert "(30 min ahead of this computer's clock)" in before
    assert "radars   left, right, rear" in text_
