#!/bin/sh
# ros2-numpy reads the quaternion of a Pose or Transform as w, x, y, z out of x, y, z, w: a pose without a turn looks backwards.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet ros2-numpy==0.0.5 numpy==1.24.2 transformations==2026.1.18 pybase64==1.4.1 \
    ros-geometry-msgs==5.5.1 ros-sensor-msgs==5.5.1 ros-nav-msgs==5.5.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
import ros2_numpy
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, Vector3

# At 10 m, looking along x; then a turn of 90 degrees to the left, written by hand and by ros2-numpy itself.
half = float(np.sqrt(0.5))
left = np.array([[0.0, -1.0, 0.0, 10.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
written = {kind.__name__: ros2_numpy.msgify(kind, left) for kind in (Pose, Transform)}
cases = {
    "Pose, ahead": Pose(position=Point(x=10.0), orientation=Quaternion(w=1.0)),
    "Transform, ahead": Transform(translation=Vector3(x=10.0), rotation=Quaternion(w=1.0)),
    "Pose, left": Pose(position=Point(x=10.0), orientation=Quaternion(z=half, w=half)),
    "Pose, left, its own": written["Pose"],
    "Transform, left, its own": written["Transform"],
}
seen = {}
for name, message in cases.items():
    seen[name] = [int(round(value)) for value in ros2_numpy.numpify(message)[:3, 0]]
    print(f"ros2-numpy {version('ros2-numpy')}, {name}: the x axis points to {seen[name]}")
orientation = written["Pose"].orientation
print(f"the Pose that it writes of the turn to the left: {orientation}")
assert seen["Pose, ahead"] == seen["Transform, ahead"] == [-1, 0, 0]
assert seen["Pose, left"] == seen["Transform, left, its own"] == [-1, 0, 0]
assert seen["Pose, left, its own"] == [0, 1, 0] and np.isclose(orientation.x, half) and orientation.z == 0.0
PYTHON
