#!/bin/sh
# mcap-ros2-support-fast misreads the float64 behind an empty list of messages: it leaves out the padding that CDR has there.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap-ros2-support-fast==0.8.0
"$folder/venv/bin/pip" install --quiet mcap-ros2-support==0.6.0
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import mcap_ros2.decoder
import mcap_ros2_support_fast.decoder
from mcap.records import Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# CDR: a float64 starts at a multiple of 8; the length of the list before it is a uint32. An empty list has nothing more.
scan, detection = "a/Detection[] detections\nfloat64 speed\n", "float64 range\nfloat64 azimuth\n"
whole = f"{scan}{'=' * 80}\nMSG: a/Detection\n{detection}"
store = get_typestore(Stores.ROS2_JAZZY)
store.register({**get_types_from_msg(scan, "a/msg/Scan"), **get_types_from_msg(detection, "a/msg/Detection")})
schema = Schema(id=1, name="a/msg/Scan", encoding="ros2msg", data=whole.encode())
seen = {}
for count in (2, 1, 0):
    detections = [store.types["a/msg/Detection"](range=30.0, azimuth=0.1)] * count
    data = bytes(store.serialize_cdr(store.types["a/msg/Scan"](detections=detections, speed=1.5), "a/msg/Scan"))
    readers = [package.decoder.DecoderFactory().decoder_for("cdr", schema) for package in (mcap_ros2_support_fast, mcap_ros2)]
    seen[count] = [reader(data).speed for reader in readers] + [store.deserialize_cdr(data, "a/msg/Scan").speed]
    print(
        f"{count} detections, a speed of 1.5 m/s: mcap-ros2-support-fast {version('mcap-ros2-support-fast')} {seen[count][0]}, "
        f"mcap-ros2-support {version('mcap-ros2-support')} {seen[count][1]}, rosbags {version('rosbags')} {seen[count][2]}"
    )
assert seen == {2: [1.5, 1.5, 1.5], 1: [1.5, 1.5, 1.5], 0: [0.0, 1.5, 1.5]}
PYTHON
