#!/bin/sh
# numba adds up an array of float32 in float32, one by one: of a million ranges of 1000 +- 1 m the mean is 1009 m, and the standard deviation 9 m.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numba==0.68.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numba
import numpy as np


def figures(values):
    return np.sum(values) / values.size, np.mean(values), np.std(values)


compiled = numba.njit(figures)
ranges = np.random.default_rng(0).normal(1000.0, 1.0, 1_000_000)
shares = np.full(10_000_000, 0.1)
seen = {}
print("sum / count, mean, standard deviation")
for name, values in (("ranges", ranges), ("shares of 0.1", shares)):
    for kind in (np.float64, np.float32):
        both = [[round(float(figure), 3) for figure in one(values.astype(kind))] for one in (figures, compiled)]
        seen[name, kind] = both
        print(f"{name}, {kind.__name__}: numpy {version('numpy')} {both[0]}, numba {version('numba')} {both[1]}")
for name, right in (("ranges", [1000.0, 1000.0, 1.0]), ("shares of 0.1", [0.1, 0.1, 0.0])):
    for kind in (np.float64, np.float32):
        assert np.allclose(seen[name, kind][0], right, atol=3e-3)
    assert np.allclose(seen[name, np.float64][1], right, atol=3e-3)
assert all(1008 < mean < 1010 for mean in seen["ranges", np.float32][1][:2]) and seen["ranges", np.float32][1][2] > 8
assert all(0.108 < mean < 0.11 for mean in seen["shares of 0.1", np.float32][1][:2])
PYTHON
