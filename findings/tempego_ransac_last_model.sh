#!/bin/sh
# tempEgo's RANSAC gives the speed of the last model that had enough detections, not of the best one: a truck ahead can be taken for the world.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet tempEgo==0.0.1 numpy==2.4.6 scipy==1.17.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from tempEgo import RANSAC
from tempEgo.error_and_loss_function import mean_square_error, square_error_loss

RANSAC.rng = np.random.default_rng(1)
random = np.random.default_rng(2)
# A sensor moves at 10 m/s. 60 detections of what stands still, exact; 30 of a truck that goes as fast, with a noise of 0.05 m/s.
azimuth = np.concatenate([random.uniform(-1.0, 1.0, 60), random.uniform(-0.2, 0.2, 30)])
doppler = np.concatenate([-10.0 * np.cos(azimuth[:60]), random.normal(0.0, 0.05, 30)])
best = []  # squared error of each model that had more than z detections


def metric(measured, predicted):
    best.append(mean_square_error(measured, predicted))
    return best[-1]


speeds, bests, lasts = [], [], []
for _ in range(200):
    best.clear()
    chosen = RANSAC.RANSAC(n=2, k=50, epsilon=0.04, z=20, loss=square_error_loss, metric=metric)
    speeds.append(chosen.separate_points((azimuth, doppler))[0])
    bests.append(min(best))
    lasts.append(best[-1])
world, truck = np.isclose(speeds, 10.0, atol=0.2), np.isclose(speeds, 0.0, atol=0.2)
print(
    f"tempEgo {version('tempEgo')}, 200 runs: the best model was always that of the world (squared error up to {max(bests):.0e}); "
    f"the speed given was 10 m/s in {world.sum()} runs, 0 m/s in {truck.sum()}"
)
assert max(bests) < 1e-20 and (world | truck).all()
assert (world == (np.array(lasts) < 1e-20)).all() and 20 < truck.sum() < 180  # the world's where the last model was
PYTHON
