#!/bin/sh
# edgefirst-schemas gives the cells of a nav_msgs/OccupancyGrid unsigned: unknown, -1 in the message and in rosbags, is 255.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet edgefirst-schemas==4.1.0 rosbags==0.11.9
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import numpy as np
from edgefirst.schemas import nav_msgs
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
of = store.types
stamp = of["builtin_interfaces/msg/Time"](sec=1, nanosec=0)
pose = of["geometry_msgs/msg/Pose"](
    position=of["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0), orientation=of["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
)
info = of["nav_msgs/msg/MapMetaData"](map_load_time=stamp, resolution=0.25, width=3, height=1, origin=pose)
header = of["std_msgs/msg/Header"](stamp=stamp, frame_id="map")
grid = of["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=np.array([-1, 0, 100], np.int8))
data = bytes(store.serialize_cdr(grid, "nav_msgs/msg/OccupancyGrid"))
back = store.deserialize_cdr(data, "nav_msgs/msg/OccupancyGrid").data.tolist()
theirs = list(bytes(nav_msgs.OccupancyGrid.from_cdr(data).data))
print(f"edgefirst-schemas {version('edgefirst-schemas')}: {theirs}, rosbags {version('rosbags')}: {back}")
assert back == [-1, 0, 100]
assert theirs == [255, 0, 100]
PYTHON
