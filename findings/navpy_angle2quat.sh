#!/bin/sh
# navpy's angle2quat halves the angles in the arrays that it is given: asked twice about one drive, it gives half the turns.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet navpy==1.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import navpy
import numpy as np

# A level drive with a turn to the right, in radians; then the same in degrees, of which it makes radians, a copy.
yaw = np.deg2rad([0.0, 30.0, 60.0, 90.0])
level = np.zeros(4)
seen = []
for _ in range(3):
    q0, vector = navpy.angle2quat(yaw, level, level.copy())
    seen.append(np.rad2deg(2 * np.arctan2(vector[:, 2], q0)).round(6).tolist())
    print(f"navpy {version('navpy')}: the quaternions turn by {seen[-1]} degrees, the yaws are then {np.rad2deg(yaw).round(6).tolist()}")
assert seen == [[0.0, 30.0, 60.0, 90.0], [0.0, 15.0, 30.0, 45.0], [0.0, 7.5, 15.0, 22.5]]
assert np.allclose(np.rad2deg(yaw), [0.0, 3.75, 7.5, 11.25])
degrees = np.array([0.0, 30.0, 60.0, 90.0])
navpy.angle2quat(degrees, level, level.copy(), input_unit="deg")
navpy.angle2dcm(yaw, level, level)
assert degrees.tolist() == [0.0, 30.0, 60.0, 90.0] and np.allclose(np.rad2deg(yaw), [0.0, 3.75, 7.5, 11.25])
PYTHON
