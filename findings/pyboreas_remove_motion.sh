#!/bin/sh
# pyboreas's remove_motion leaves a point cloud as it is that is not sorted by time, as its own random_downsample makes it: other processes moved copies.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet asrl-pyboreas==2.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from pyboreas.data.pointcloud import PointCloud

# A wall 20 m ahead, in 200 points over 0.1 s, seen from a car at 10 m/s: 1 m between the first and the last.
points = np.zeros((200, 6))
points[:, 0] = 20.0
points[:, 5] = 1600000000.0 + np.linspace(0.0, 0.1, 200)
speed = np.array([[10.0], [0.0], [0.0], [0.0], [0.0], [0.0]])
np.random.seed(1)
clouds = {name: PointCloud(points.copy()) for name in ("sorted", "shuffled", "a half of it")}
np.random.shuffle(clouds["shuffled"].points)
clouds["a half of it"].random_downsample(0.5)
moved = {}
for name, cloud in clouds.items():
    cloud.remove_motion(speed, tref=1600000000.0)
    moved[name] = float(np.abs(cloud.points[:, 0] - 20.0).max())
    print(f"asrl-pyboreas {version('asrl-pyboreas')}, {name}: remove_motion moved points by up to {moved[name]:.2f} m")
assert 0.9 < moved["sorted"] < 1.01 and moved["shuffled"] == moved["a half of it"] == 0.0
PYTHON
