#!/bin/sh
# octomap-python's search gives a node for a cell that nothing has seen, which raises when it is asked; pyoctomap gives None.
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

seen = {}
for package in (octomap, pyoctomap):
    tree = package.OcTree(0.1)
    tree.insertPointCloud(np.array([[1.05, 0.05, 0.05]]), np.array([0.05, 0.05, 0.05]))
    node = tree.search(np.array([3.0, 3.0, 3.0]))
    try:
        seen[package.__name__] = "None" if node is None else f"{node.getOccupancy()}"
    except Exception as error:
        seen[package.__name__] = type(error).__name__
print(f"octomap-python {version('octomap-python')}, pyoctomap {version('pyoctomap')}: a cell that nothing has seen is {seen}")
assert seen == {"octomap": "NullPointerException", "pyoctomap": "None"}
PYTHON
