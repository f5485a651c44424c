#!/bin/sh
# The deleteNode of octomap-python and pyoctomap, asked to delete one cell, deletes the eighth of the space that the cell is in; OctoMap's own does not.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet octomap-python==1.10.0.0 pyoctomap==1.2.2 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import octomap
import pyoctomap

# A wall along x, 40 cells in front and 40 behind, at y = z = 1 m. OctoMap's deleteNode(point, depth = 0) deletes one leaf;
# both packages have depth=1, a step below the root: one of the root's eight children, whatever its size.
for name, package in (("octomap-python", octomap), ("pyoctomap", pyoctomap)):
    left = {}
    for said, depth in (("deleteNode(point)", ()), ("deleteNode(point, 0)", (0,))):
        tree = package.OcTree(0.25)
        for x in np.arange(0.125, 20.0, 0.5):
            for sign in (1.0, -1.0):
                tree.updateNode(np.array([sign * x, 1.0, 1.0]), True)
        before = tree.getNumLeafNodes()
        tree.deleteNode(np.array([0.125, 1.0, 1.0]), *depth)
        left[said] = tree.getNumLeafNodes()
        print(f"{name} {version(name)}: of {before} cells {said} leaves {left[said]}")
        assert before == 80
    assert left == {"deleteNode(point)": 40, "deleteNode(point, 0)": 79}
PYTHON
