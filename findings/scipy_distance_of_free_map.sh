#!/bin/sh
# scipy's distance_transform_edt of a map without an obstacle gives distances to one just outside its first corner; OpenCV's and edt's are endless.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet scipy==1.17.1 numpy==2.4.6 opencv-python-headless==5.0.0.93 edt==3.1.2
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import cv2
import edt
import numpy as np
from scipy import ndimage

free = np.ones((100, 100), np.uint8)
there = free.copy()
there[99, 99] = 0
seen = {}
for name, cells in (("a free map", free), ("one with an obstacle in the last corner", there)):
    distance, nearest = ndimage.distance_transform_edt(cells, return_indices=True)
    found = {
        f"scipy {version('scipy')}": distance,
        f"opencv-python-headless {version('opencv-python-headless')}": cv2.distanceTransform(cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE),
        f"edt {version('edt')}": edt.edt(cells),
    }
    seen[name] = [float(one[0, 0]) for one in found.values()]
    print(f"{name}: in the first corner {dict(zip(found, seen[name]))}; to scipy the nearest obstacle is at {nearest[:, 0, 0].tolist()}")
    seen[name, "nearest"] = nearest[:, 0, 0].tolist()
corner = 99 * 2**0.5
assert np.allclose(seen["one with an obstacle in the last corner"], corner)
assert seen["one with an obstacle in the last corner", "nearest"] == [99, 99]
assert seen["a free map"][0] == 1.0 and min(seen["a free map"][1:]) > 1e9 and seen["a free map", "nearest"] == [-1, 0]
PYTHON
