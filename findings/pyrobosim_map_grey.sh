#!/bin/sh
# pyrobosim knows the grey values 0, 205 and 254 of a ROS map alone: a wall of grey 10 is no obstacle to it, and "negate: 1" it does not read.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyrobosim==5.0.1 numpy==2.4.6 pillow==13.0.0 PyYAML==6.0.4
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import yaml
from PIL import Image
from pyrobosim.navigation.occupancy_grid import OccupancyGrid


def occupied(row, negate):
    """Which cells of one row of grey values are obstacles: as map_server's documents have it, and to pyrobosim."""
    Image.fromarray(np.array([row], np.uint8)).save("map.pgm")
    keys = {"image": "map.pgm", "resolution": 0.1, "origin": [0.0, 0.0, 0.0], "negate": negate, "occupied_thresh": 0.65, "free_thresh": 0.196}
    with open("map.yaml", "w") as file:
        yaml.safe_dump(keys, file)
    grid = OccupancyGrid.from_file(".", "map")
    probability = [grey / 255 if negate else (255 - grey) / 255 for grey in row]
    return [p > 0.65 for p in probability], [bool(grid.is_occupied((place, 0))) for place in range(len(row))]


maps = {"three values": ([254, 0, 205, 254], 0), "a scale": ([250, 10, 60, 120], 0), "negate: 1": ([0, 254, 0, 0], 1)}
seen = {name: occupied(*one) for name, one in maps.items()}
for name, (meant, found) in seen.items():
    print(f"pyrobosim {version('pyrobosim')}, {name}, grey {maps[name][0]}: obstacles {found}; by the thresholds {meant}")
assert seen == {
    "three values": ([False, True, False, False], [False, True, False, False]),
    "a scale": ([False, True, True, False], [False, False, False, False]),
    "negate: 1": ([False, True, False, False], [True, False, True, True]),
}
PYTHON
