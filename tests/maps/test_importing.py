"""Maps of other formats as stores."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tests.support.stores import CELL, window

from echogrid.maps import map_server
from echogrid.maps.importing import import_map


def test_what_lies_between_cells_is_moved_onto_them_and_said(tmp_path: Path) -> None:
    map_server.write(tmp_path / "map.yaml", np.zeros((4, 4), np.uint8), (1.1, -0.3), CELL, "trinary")
    assert "; moved by 0.100 m, onto whole cells; not in" in import_map(tmp_path / "map.yaml", tmp_path / "map.egmap")
    log_odds, origin = window(tmp_path / "map.egmap")
    assert (log_odds.tolist(), origin) == ([[3.5] * 4] * 4, (1.0, -0.25))
