#!/bin/sh
# stonesoup's cubature Kalman filter averages a bearing behind the sensor, at the step from 180 to -180 degrees, as a plain number: its track leaves the detection.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet stonesoup==1.9.1 numpy==2.4.6
cd "$folder"
venv/bin/python -W ignore - <<'PYTHON'
from datetime import datetime
from importlib.metadata import version

import numpy as np
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.types.angle import Bearing
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import StateVector
from stonesoup.updater.kalman import CubatureKalmanUpdater, ExtendedKalmanUpdater, UnscentedKalmanUpdater

now = datetime(2020, 1, 1)
radar = CartesianToBearingRange(4, mapping=[0, 2], noise_covar=np.diag([0.01**2, 0.1**2]))


def updated(updater, side):
    """(x, y) and the variance of y in m behind an update, turned so that side 1 (10 m ahead) and -1 (10 m behind the sensor) have to agree."""
    predicted = GaussianStatePrediction(StateVector([10.0 * side, 0.0, -0.05 * side, 0.0]), np.diag([0.2, 0.1, 0.2, 0.1]), timestamp=now)
    seen = StateVector([Bearing(np.arctan2(0.04 * side, 10.0 * side)), 10.0])
    state = updater(radar).update(SingleHypothesis(predicted, Detection(seen, timestamp=now, measurement_model=radar)))
    return [round(side * float(state.state_vector[place]), 2) + 0.0 for place in (0, 2)] + [round(float(state.covar[2, 2]), 3)]


found = {}
for updater in (ExtendedKalmanUpdater, UnscentedKalmanUpdater, CubatureKalmanUpdater):
    found[updater.__name__] = {"ahead": updated(updater, 1), "behind": updated(updater, -1)}
    print(f"stonesoup {version('stonesoup')}, {updater.__name__}: x, y and the variance of y {found[updater.__name__]}")
for name in ("ExtendedKalmanUpdater", "UnscentedKalmanUpdater"):
    assert found[name]["ahead"] == found[name]["behind"]
cubature = found["CubatureKalmanUpdater"]
assert cubature["ahead"] == [9.99, 0.04, 0.01] and cubature["behind"] != cubature["ahead"]
assert cubature["behind"][1] < 0 and cubature["behind"][2] > 0.19  # no nearer to the detection, as unsure as before
PYTHON
