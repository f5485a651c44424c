#!/bin/sh
# xwr's angles have no bin at 0: what is straight ahead is 0.9 degrees beside it with 64 bins, 8 with 8, and with the elevation's own two not there at all.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet xwr==0.5.1 numpy==2.4.6 scipy==1.17.1
cd "$folder"
venv/bin/python -W ignore - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from xwr.rsp.numpy import AWR1843Boost, PointCloud

# All antennas in phase: one reflector straight ahead, in the range bin 3 of 4.
in_phase = np.ones((1, 2, 3, 4, 4), np.complex64)  # batch, doppler, tx, rx, range
seen = {}
for name, size in {"not padded": {}, "8 and 8 bins": {"azimuth": 8, "elevation": 8}, "64 and 64 bins": {"azimuth": 64, "elevation": 64}}.items():
    spectrum = np.abs(AWR1843Boost(size=size).elevation_azimuth(in_phase)).astype(np.float32)
    peak = [int(place) for place in np.unravel_index(np.argmax(spectrum[0, 1, :, :, 3]), spectrum.shape[2:4])]
    assert peak == [spectrum.shape[2] // 2, spectrum.shape[3] // 2]  # the bins of no phase shift, behind fftshift
    cloud = PointCloud()(spectrum, np.ones((1, 4, 2), bool))
    x, y, z, _ = cloud.points[0, 3, 1]
    found = float(np.rad2deg(np.arctan2(y, x))), float(np.rad2deg(np.arctan2(z, np.hypot(x, y)))), bool(cloud.mask[0, 3, 1])
    seen[name] = found
    print(f"xwr {version('xwr')}, {name}: azimuth {found[0]:.1f}, elevation {found[1]:.1f} degrees, in the point cloud: {found[2]}")
assert abs(seen["not padded"][1] - 90.0) < 0.1 and not seen["not padded"][2]
assert np.allclose(seen["8 and 8 bins"], (-8.2, 8.2, 1.0), atol=0.1)
assert np.allclose(seen["64 and 64 bins"], (-0.9, 0.9, 1.0), atol=0.1)
PYTHON
