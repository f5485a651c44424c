#!/bin/sh
# nuscenes-devkit's RadarPointCloud refuses a PCD file that ends with its last point, and drops a whole scan whose first point is not a number.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cachetools==8.0.2 numpy==2.4.6 matplotlib==3.11.2 opencv-python-headless==5.0.0.93 pillow==13.0.0 pyquaternion==0.9.9 scikit-learn==1.9.1 shapely==2.2.0 tqdm==4.70.1
"$folder/venv/bin/pip" install --quiet --no-deps nuscenes-devkit==1.1.11
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from nuscenes.utils.data_classes import RadarPointCloud

names = "x y z dyn_prop id rcs vx vy vx_comp vy_comp is_quality_valid ambig_state x_rms y_rms invalid_state pdh0 vx_rms vy_rms".split()
kinds = "f4 f4 f4 i1 i2 f4 f4 f4 f4 f4 i1 i1 i1 i1 i1 i1 i1 i1".split()


def scan(xs, behind):
    points = np.zeros(len(xs), list(zip(names, kinds, strict=True)))
    points["x"], points["ambig_state"] = xs, 3
    head = ["# .PCD v0.7", "VERSION 0.7", "FIELDS " + " ".join(names), "SIZE " + " ".join(kind[1] for kind in kinds)]
    head += ["TYPE " + " ".join(kind[0].upper() for kind in kinds), "COUNT" + " 1" * len(names), f"WIDTH {len(xs)}", "HEIGHT 1"]
    head += ["VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {len(xs)}", "DATA binary", ""]
    open("a.pcd", "wb").write("\n".join(head).encode() + points.tobytes() + behind)
    try:
        return RadarPointCloud.from_file("a.pcd").nbr_points()
    except AssertionError:
        return "AssertionError"


seen = scan([1, 2], b""), scan([1, 2], b"\n"), scan([1, np.nan, 2], b"\n"), scan([np.nan, 1, 2], b"\n")
print(
    f"nuscenes-devkit {version('nuscenes-devkit')}: two points and no more: {seen[0]}; a line's end behind them: {seen[1]} points; "
    f"three, the second NaN: {seen[2]}; three, the first NaN: {seen[3]}"
)
assert seen == ("AssertionError", 2, 3, 0)
PYTHON
