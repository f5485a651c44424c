#!/bin/sh
# nuscenes-devkit's RadarPointCloud turns the positions and not the velocities: in another radar's or the car's frame a car drives sideways.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cachetools==8.0.2 numpy==2.4.6 matplotlib==3.11.2 opencv-python-headless==5.0.0.93 pillow==13.0.0
"$folder/venv/bin/pip" install --quiet pyquaternion==0.9.9 scikit-learn==1.9.1 shapely==2.2.0 tqdm==4.70.1
"$folder/venv/bin/pip" install --quiet --no-deps nuscenes-devkit==1.1.11
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from nuscenes.utils.data_classes import RadarPointCloud
from nuscenes.utils.geometry_utils import transform_matrix
from pyquaternion import Quaternion

# Rows of the data set's radar points: 0 to 2 x, y, z; 6, 7 vx, vy; 8, 9 vx_comp, vy_comp. A radar that looks to the left, at 3, 1, 0 of the car.
left = Quaternion(axis=[0, 0, 1], degrees=90)
seen = {}
for name in ("rotate", "transform"):
    points = np.zeros((18, 1))
    points[[0, 6, 8], 0] = 20.0, -5.0, -5.0  # 20 m before the radar, and coming at 5 m/s
    cloud = RadarPointCloud(points)
    if name == "rotate":
        cloud.rotate(left.rotation_matrix)
    else:
        cloud.transform(transform_matrix([3.0, 1.0, 0.0], left))
    seen[name] = [tuple((cloud.points[rows, 0].round(3) + 0.0).tolist()) for rows in ([0, 1], [6, 7], [8, 9])]
    place, *speeds = seen[name]
    print(f"nuscenes-devkit {version('nuscenes-devkit')}, {name}: x, y {place}, vx, vy {speeds[0]}, compensated {speeds[1]}, expected (0.0, -5.0)")
assert seen == {
    "rotate": [(0.0, 20.0), (-5.0, 0.0), (-5.0, 0.0)],
    "transform": [(3.0, 21.0), (-5.0, 0.0), (-5.0, 0.0)],
}
PYTHON
