#!/bin/sh
# asammdf reckons with a signal of whole numbers in the signal's own eight bits: 1 m - 3 m are 254 m, and 100 km/h faster than 200 are 44.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet asammdf==8.8.28
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
from asammdf import MDF, Signal, __version__

with MDF() as file:
    time = np.array([0.0, 1.0, 2.0])
    near = Signal(np.array([1, 2, 3], np.uint8), time, name="near", unit="m")
    file.append([near, Signal(np.array([3, 3, 3], np.uint8), time, name="far", unit="m")])
    file.save("a.mf4")
with MDF("a.mf4") as file:
    near, far = file.get("near"), file.get("far")
    difference = (near - far).samples.tolist()
    faster = (Signal(np.array([200], np.uint8), [0.0], name="speed", unit="km/h") + 100).samples.tolist()
print(f"asammdf {__version__}: {near.samples.tolist()} m - {far.samples.tolist()} m are {difference}, 200 km/h + 100 are {faster}")
assert (difference, faster) == ([254, 255, 0], [44])
PYTHON
