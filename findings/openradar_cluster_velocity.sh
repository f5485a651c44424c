#!/bin/sh
# openradar's radar_dbscan gives each cluster the mean velocity of all detections: a car that comes and one that goes both stand still.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 scipy==1.17.1 scikit-learn==1.9.1 matplotlib==3.11.2
"$folder/venv/bin/pip" install --quiet --no-deps openradar==1.0.1
cd "$folder"
venv/bin/python -W ignore - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from mmwave.clustering import radar_dbscan

# rangeIdx, dopplerIdx, peakVal, x, y, z: three detections of a car with 0.1 m/s times 80, three of one with 0.1 m/s times -80.
coming = [[50, 80, 1, -2.0 + 0.3 * step, 10.0, 0] for step in range(3)]
going = [[90, -80, 1, 4.0 + 0.3 * step, 18.0, 0] for step in range(3)]


def clusters(detections):
    found = radar_dbscan(np.array(detections, float), weight=0.0, doppler_resolution=0.1)
    return [([round(float(place), 1) for place in one["center"]], int(one["num_points"]), round(float(one["avgVelocity"]), 2) + 0.0) for one in found]


alone, both = clusters(coming) + clusters(going), clusters(coming + going)
print(f"openradar {version('openradar')}: each car alone (centre in m, detections, m/s) {alone}; both together {both}")
assert [velocity for _, _, velocity in alone] == [8.0, -8.0]
assert [one[:2] for one in both] == [one[:2] for one in alone] and [velocity for _, _, velocity in both] == [0.0, 0.0]
PYTHON
