#!/bin/sh
# openradar's OS-CFAR has its guard cells on one side alone: of a target of three cells it finds two, and which ones depends on the direction.
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
from mmwave import dsp

# 24 cells with a noise of 1 and a target of 10 in the cells 11 to 13; windows of two cells, two guard cells on each side, the third of four values.
power = np.ones(24)
power[11:14] = 10.0
size, guard, noise, rank = len(power), 2, 2, 2


def by_definition(x):
    floor = []
    for cell in range(size):
        near = [cell - guard - step for step in range(1, noise + 1)] + [cell + guard + step for step in range(1, noise + 1)]
        floor.append(sorted(x[place % size] for place in near)[rank])
    return np.flatnonzero(x > np.array(floor)).tolist()


seen = {
    "by definition": by_definition(power),
    "openradar": np.flatnonzero(dsp.os(power, guard_len=guard, noise_len=noise, k=rank)).tolist(),
    "openradar, from the other end": (size - 1 - np.flatnonzero(dsp.os(power[::-1].copy(), guard_len=guard, noise_len=noise, k=rank))[::-1]).tolist(),
    "openradar's CA-CFAR": np.flatnonzero(dsp.ca(power, guard_len=guard, noise_len=noise, l_bound=1.0)).tolist(),
}
for name, cells in seen.items():
    print(f"openradar {version('openradar')}, {name}: the target is in the cells {cells}")
assert seen["by definition"] == seen["openradar's CA-CFAR"] == [11, 12, 13]
assert seen["openradar"] != [11, 12, 13] and seen["openradar"] != seen["openradar, from the other end"]
PYTHON
