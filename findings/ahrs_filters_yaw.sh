#!/bin/sh
# Of one turn to the left, ahrs's Madgwick and Mahony filters make a left turn, its AQUA a right turn, and its Complementary, without a magnetometer, none.
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

# On level ground, 0.2 rad/s about the axis that points up, for 1 s: 11.46 degrees to the left.
turns = np.tile([0.0, 0.0, 0.2], (101, 1))
gravity = np.tile([0.0, 0.0, 9.81], (101, 1))
seen = {}
for name in ("Madgwick", "Mahony", "AngularRate", "AQUA", "Complementary"):
    more = {} if name == "AngularRate" else {"acc": gravity}
    turned = getattr(ahrs.filters, name)(gyr=turns, frequency=100.0, **more).Q[-1]
    seen[name] = float(np.degrees(ahrs.Quaternion(turned).to_angles()[2]).round(2)) + 0.0
print(f"ahrs {version('ahrs')}: yaw in degrees: {seen}")
assert seen == {"Madgwick": 11.46, "Mahony": 11.46, "AngularRate": 11.46, "AQUA": -11.46, "Complementary": 0.0}
PYTHON
