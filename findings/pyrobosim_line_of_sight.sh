#!/bin/sh
# pyrobosim's has_straight_line_connection gives as the last point that can be reached the last obstacle on the line, behind all the others.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyrobosim==5.0.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from pyrobosim.navigation.occupancy_grid import OccupancyGrid

# Ten cells in a row, walls in the cells 2 and 7.
cells = np.zeros((10, 1))
cells[[2, 7]] = 1
grid = OccupancyGrid(cells, 0.1)
seen = {way: grid.has_straight_line_connection(*way) for way in [((0, 0), (9, 0)), ((9, 0), (0, 0)), ((3, 0), (6, 0))]}
for (start, end), (free, last) in seen.items():
    print(f"pyrobosim {version('pyrobosim')}, walls at 2 and 7, from {start[0]} to {end[0]}: free {free}, the last point that can be reached {last[0]}")
assert list(seen.values()) == [(False, (7, 0)), (False, (2, 0)), (True, (6, 0))]  # 1 and 8 can be reached
PYTHON
