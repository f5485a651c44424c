#!/bin/sh
# filterpy's square root Kalman filter takes none of the process noise that filterpy's own Q_discrete_white_noise makes, nor none at all.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet filterpy==2.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from filterpy.common import Q_continuous_white_noise, Q_discrete_white_noise
from filterpy.kalman import KalmanFilter, SquareRootKalmanFilter

# One random acceleration a step makes noise of rank 1 of a position and a speed: as valid as a covariance of 0.
noises = {
    "continuous": Q_continuous_white_noise(2, dt=1.0),
    "discrete": Q_discrete_white_noise(2, dt=1.0),
    "discrete, with acceleration": Q_discrete_white_noise(3, dt=1.0),
    "none": np.zeros((2, 2)),
}
seen = {}
for name, noise in noises.items():
    for kind in (KalmanFilter, SquareRootKalmanFilter):
        one = kind(len(noise), 1)
        try:
            one.Q = noise
            one.predict()
            seen.setdefault(name, []).append("taken")
        except np.linalg.LinAlgError as error:
            seen.setdefault(name, []).append(f"LinAlgError: {error}")
    print(f"filterpy {version('filterpy')}, {name}: KalmanFilter {seen[name][0]}, SquareRootKalmanFilter {seen[name][1]}")
assert [said.split(":")[0] for _, said in seen.values()] == ["taken", "LinAlgError", "LinAlgError", "LinAlgError"]
assert all(said == "taken" for said, _ in seen.values())
PYTHON
