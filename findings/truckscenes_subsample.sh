#!/bin/sh
# truckscenes-devkit's subsample draws points with repetition and leaves the lidar's times as they were: half of the points have all of the times.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pypcd4==1.5.1 pyquaternion==0.9.9 numpy==2.4.6 tqdm==4.70.1
"$folder/venv/bin/pip" install --quiet --no-deps truckscenes-devkit==1.2.0
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pypcd4
from truckscenes.utils.data_classes import LidarPointCloud

# 1000 points, one a meter along x, each with its own time in µs.
count = 1000
fields = [np.arange(count, dtype=np.float32), np.ones(count, np.float32), np.ones(count, np.float32), np.zeros(count, np.float32)]
times = 1600000000000000 + 10 * np.arange(count, dtype=np.uint64)
kinds = (np.float32, np.float32, np.float32, np.float32, np.uint64)
pypcd4.PointCloud.from_points([*fields, times], ("x", "y", "z", "intensity", "timestamp"), kinds).save("a.pcd")
np.random.seed(1)
cloud = LidarPointCloud.from_file("a.pcd")
assert cloud.points.shape == (4, count) and cloud.timestamps.shape == (1, count)
cloud.subsample(0.5)
different = len(np.unique(cloud.points[0]))
try:
    cloud.remove_close(1.0)
    raised = None
except IndexError as error:
    raised = f"IndexError: {error}"
print(f"truckscenes-devkit {version('truckscenes-devkit')}: half of {count} points are {cloud.nbr_points()}, {different} of them different, ")
print(f"with {cloud.timestamps.shape[1]} times; remove_close then: {raised}")
assert cloud.nbr_points() == 500 and 350 < different < 450 and cloud.timestamps.shape == (1, count)
assert raised is not None and "boolean index did not match" in raised

whole = LidarPointCloud.from_file("a.pcd")
whole.subsample(1.0)
left = len(np.unique(whole.points[0]))
print(f"subsample(1.0), all of them: {left} of {count} points are left")
assert 580 < left < 680
PYTHON
