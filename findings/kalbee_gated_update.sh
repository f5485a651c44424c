#!/bin/sh
# kalbee's gated_update judges a measurement by the one before it: it takes an outlier, and then refuses all that follows.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet kalbee==1.0.0 numpy==2.4.6 scipy==1.17.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from kalbee import KalmanFilter, gated_update

# Something that stands at 0 m, measured to 1 m, with one ghost at 1000 m. The gate is at 95 %.
one = np.eye(1)
measured = [0.1, -0.1, 0.0, 1000.0, 0.1, 0.0, -0.1, 0.1]
taken = {}
for name in ("gated_update", "the gate itself"):
    tracker = KalmanFilter(np.zeros((1, 1)), one, one, 0.01 * one, one, one)
    taken[name] = []
    for value in measured:
        tracker.predict()
        measurement = np.array([[value]])
        if name == "the gate itself":
            # What the gate is meant to be: this measurement's own distance, in the units of its own covariance.
            distance = ((measurement - tracker.state) ** 2 / (tracker.covariance + one)).item()
            if passed := distance <= 3.841:
                tracker.update(measurement)
        else:
            passed, _ = gated_update(tracker, measurement)
        taken[name].append(passed)
    at = tracker.state.item()
    print(f"kalbee {version('kalbee')}, {name}: takes {[value for value, ok in zip(measured, taken[name]) if ok]}, is at {at:.2f} m")
    assert abs(at) < 0.1 if name == "the gate itself" else 200 < at < 220
assert taken["gated_update"] == [True] * 4 + [False] * 4
assert taken["the gate itself"] == [True] * 3 + [False] + [True] * 4
PYTHON
