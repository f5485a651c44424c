#!/bin/sh
# pypcd4 takes the fields of a PointCloud2 for sorted by their offsets, and its numbers for little-endian, whatever the message says.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pypcd4==1.5.1
"$folder/venv/bin/pip" install --quiet pointcloud2==0.6.0
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version
from types import SimpleNamespace

import numpy as np
import pointcloud2
from pypcd4 import PointCloud

# sensor_msgs/PointField and PointCloud2: each field has its offset, and the message says whether its numbers are big-endian.
# The layout is that of PCL's PointXYZI: 32 bytes a point, the fourth value at 16.
offsets = {"x": 0, "y": 4, "z": 8, "rcs": 16}


def message(names, order):
    points = np.zeros(1, np.dtype({"names": list(offsets), "formats": [f"{order}f4"] * 4, "offsets": list(offsets.values()), "itemsize": 32}))
    points["x"], points["y"], points["z"], points["rcs"] = 1, 2, 3, 40
    fields = [SimpleNamespace(name=name, offset=offsets[name], datatype=7, count=1) for name in names]
    data = np.frombuffer(points.tobytes(), np.uint8)
    return SimpleNamespace(
        header=None, height=1, width=1, fields=fields, is_bigendian=order == ">", point_step=32, row_step=32, data=data, is_dense=True
    )


seen = {}
for kind, names, order in (("in order", "x y z rcs", "<"), ("rcs told first", "rcs x y z", "<"), ("big-endian", "x y z rcs", ">")):
    cloud = message(names.split(), order)
    both = PointCloud.from_msg(cloud).pc_data, pointcloud2.read_points(cloud)
    seen[kind] = [tuple(float(found[name].ravel()[0]) for name in offsets) for found in both]
    print(f"{kind}: pypcd4 {version('pypcd4')} {seen[kind][0]}, pointcloud2 {version('pointcloud2')} {seen[kind][1]}")
expected = 1.0, 2.0, 3.0, 40.0
assert all(other == expected for _, other in seen.values()) and seen["in order"][0] == expected
assert seen["rcs told first"][0] == (0.0, 0.0, 0.0, 40.0)
assert seen["big-endian"][0][0] == float(np.array(1, ">f4").view("<f4"))
PYTHON
