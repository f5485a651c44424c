#!/bin/sh
# rosbags writes the bits of an integer covariance as float64: 1 becomes 5e-324; it refuses float32, and wrong lengths.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
of = store.types
pose = of["geometry_msgs/msg/Pose"](
    position=of["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0), orientation=of["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
)
kind = "geometry_msgs/msg/PoseWithCovariance"
seen = {}
given = {"float": np.diag([1.0, 1.0, 4.0, 4.0, 4.0, 1.0]), "integer": np.diag([1, 1, 4, 4, 4, 1]), "float32": np.eye(6, dtype=np.float32)}
for name, covariance in given.items():
    try:
        data = bytes(store.serialize_cdr(of[kind](pose=pose, covariance=covariance.ravel()), kind))
        seen[name] = store.deserialize_cdr(data, kind).covariance[[0, 14]].tolist()
    except ValueError as error:
        seen[name] = f"ValueError: {error}"
print(f"rosbags {version('rosbags')}: the variances 1 and 4 come back as {seen}")
assert seen["float"] == [1.0, 4.0] and seen["integer"] == [5e-324, 2e-323] and seen["float32"].startswith("ValueError")
PYTHON
