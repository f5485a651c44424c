#!/bin/sh
# ahrs takes rpy= of a DCM as yaw, pitch, roll, and of a Quaternion as roll, pitch, yaw; DCM.to_rpy gives back neither.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ahrs==0.4.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import ahrs
import numpy as np

# Both documentations: an array with roll, pitch and yaw. Roll is about x.
given = np.radians([10.0, 0.0, 90.0])
forward, left = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
matrices = {"Quaternion": ahrs.Quaternion(rpy=given).to_DCM(), "DCM": np.asarray(ahrs.DCM(rpy=given))}
seen = {}
for name, matrix in matrices.items():
    seen[name] = [[round(float(one), 3) + 0.0 for one in matrix @ axis] for axis in (forward, left)]
    print(f"ahrs {version('ahrs')}: {name} of roll 10, pitch 0, yaw 90 degrees: forward is {seen[name][0]}, left {seen[name][1]}")
other = np.radians([10.0, 20.0, 30.0])
back = [np.degrees(angles).round(1).tolist() for angles in (ahrs.Quaternion(rpy=other).to_angles(), ahrs.DCM(rpy=other).to_rpy())]
print(f"roll 10, pitch 20 and yaw 30 degrees, asked for again: Quaternion {back[0]}, DCM {back[1]}")
assert seen["Quaternion"] == [[0.0, 1.0, 0.0], [-0.985, 0.0, 0.174]]  # turned to the left, tilted by 10 degrees
assert seen["DCM"] == [[0.985, 0.174, 0.0], [0.0, 0.0, 1.0]]  # turned by 10 degrees, lying on its side
assert back == [[10.0, 20.0, 30.0], [-28.5, -22.2, 1.1]]
PYTHON
