#!/bin/sh
# ros2-numpy takes the place of a PointCloud2's field in the list for its place in bytes: the intensity that it gives is a piece of x.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ros2-numpy==0.0.5 numpy==1.24.2 transformations==2026.1.18 pybase64==1.4.1 pointcloud2==0.6.0 \
    ros-geometry-msgs==5.5.1 ros-sensor-msgs==5.5.1 ros-nav-msgs==5.5.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import pointcloud2
import ros2_numpy
from sensor_msgs.msg import PointCloud2, PointField

# Three detections at 1, 2 and 100 m with 50, 60 and 70 as their intensity, the layout that most drivers send: four float32.
points = np.zeros(3, [(name, "<f4") for name in ("x", "y", "z", "intensity")])
points["x"], points["intensity"] = (1, 2, 100), (50, 60, 70)
fields = [PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1) for i, name in enumerate(points.dtype.names)]
cloud = PointCloud2(height=1, width=3, fields=fields, point_step=16, row_step=48, data=points.tobytes(), is_dense=True)
found = ros2_numpy.numpify(cloud)["intensity"].ravel()
other = pointcloud2.read_points(cloud)["intensity"].ravel()
print(f"ros2-numpy {version('ros2-numpy')}: intensities {found.tolist()}; pointcloud2 {version('pointcloud2')}: {other.tolist()}")
x = np.frombuffer(points.tobytes(), np.uint8).reshape(3, 16)[:, 3:5].copy().view("<u2").ravel()
assert other.tolist() == [50.0, 60.0, 70.0] and found.tolist() == x.tolist() == [63, 64, 66]

# Its own clouds: without a colour and an intensity a point is 0 bytes long, and with an intensity it writes none.
plain = ros2_numpy.msgify(PointCloud2, {"xyz": np.ones((3, 3), np.float32)})
try:
    ros2_numpy.msgify(PointCloud2, {"xyz": np.ones((3, 3), np.float32), "intensity": np.array([50, 60, 70])})
    raised = None
except TypeError as error:
    raised = f"TypeError: {error}"
print(f"a cloud of 3 points that it writes has point_step {plain.point_step} and {len(plain.data)} bytes; one with intensities: {raised}")
assert plain.point_step == plain.row_step == 0 and len(plain.data) == 36
assert raised is not None and "hstack" in raised
PYTHON
