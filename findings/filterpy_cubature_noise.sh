#!/bin/sh
# filterpy's cubature Kalman filter leaves the process noise out of its gain and its variance: on a linear system it is not the Kalman filter.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet filterpy==2.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from filterpy.kalman import CubatureKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

# A position of 0 m and a speed of 1 m/s, a step of 1 s, and a position of 5 m measured. All three filters are exact on a linear system.
move = np.array([[1.0, 1.0], [0.0, 1.0]])
points = MerweScaledSigmaPoints(2, alpha=0.1, beta=2.0, kappa=1.0)
seen = {}
for noise in (0.0, 1.0, 100.0):
    filters = {
        "Kalman": KalmanFilter(2, 1),
        "unscented": UnscentedKalmanFilter(2, 1, 1.0, lambda x: x[:1], lambda x, dt: move @ x, points),
        "cubature": CubatureKalmanFilter(2, 1, 1.0, lambda x: x[:1], lambda x, dt: move @ x),
    }
    filters["Kalman"].F, filters["Kalman"].H = move, np.array([[1.0, 0.0]])
    seen[noise] = {}
    for name, one in filters.items():
        one.x = np.array([0.0, 1.0]) if name == "unscented" else np.array([[0.0], [1.0]])
        one.P, one.Q, one.R = np.eye(2), noise * np.eye(2), np.eye(1)
        one.predict()
        one.update(np.array([5.0]) if name == "unscented" else np.array([[5.0]]))
        seen[noise][name] = round(float(np.ravel(one.x)[0]), 3), round(float(one.P[0, 0]), 3)
    print(f"filterpy {version('filterpy')}, process noise {noise}: position and its variance {seen[noise]}")
assert seen == {
    0.0: {"Kalman": (3.667, 0.667), "unscented": (3.667, 0.667), "cubature": (3.667, 0.667)},
    1.0: {"Kalman": (4.0, 0.75), "unscented": (4.0, 0.75), "cubature": (3.667, 1.667)},
    100.0: {"Kalman": (4.961, 0.99), "unscented": (4.961, 0.99), "cubature": (3.667, 100.667)},
}
PYTHON
