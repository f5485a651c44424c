#!/bin/sh
# octomap-python's and pyoctomap's updateNode takes a bool of numpy for log-odds: False, out of a mask, is no miss but nothing at all.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6
"$folder/venv/bin/pip" install --quiet octomap-python==1.10.0.0
"$folder/venv/bin/pip" install --quiet pyoctomap==1.2.2
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import octomap
import pyoctomap

# Of a bool updateNode makes a hit or a miss, of a number log-odds that are added. Five looks at one cell.
looks = {"bool": [False] * 5, "numpy.bool": np.zeros(5, bool), "hits, bool": [True] * 2, "hits, numpy.bool": np.ones(2, bool)}
seen = {}
for package in (octomap, pyoctomap):
    for name, mask in looks.items():
        tree = package.OcTree(0.1)
        for hit in mask:
            node = tree.updateNode(np.array([1.05, 0.05, 0.05]), hit)
        seen.setdefault(name, []).append(round(node.getOccupancy(), 3))
versions = f"octomap-python {version('octomap-python')} and pyoctomap {version('pyoctomap')}"
print(f"{versions}: occupancy after five misses or two hits: {seen}")
assert seen == {"bool": [0.119, 0.119], "numpy.bool": [0.5, 0.5], "hits, bool": [0.845, 0.845], "hits, numpy.bool": [0.881, 0.881]}
PYTHON
