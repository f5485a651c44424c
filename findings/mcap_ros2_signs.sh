#!/bin/sh
# mcap-ros2-support reads a ROS 2 char as signed, -56 for 200, and the seconds of a Duration that it fills in itself as unsigned; rosbags does not.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap-ros2-support==0.6.0
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9
cd "$folder"
venv/bin/python - <<'PYTHON'
import struct
from importlib.metadata import version

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# builtin_interfaces/Duration: int32 sec, uint32 nanosec; mcap-ros2-support fills it in where a file's schema leaves it out.
# A char of ROS 2 is a uint8.
text = "builtin_interfaces/Duration age\nchar kind\n"
whole = f"{text}{'=' * 80}\nMSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n"
data = bytes((0, 1, 0, 0)) + struct.pack("<iIB", -1, 500_000_000, 200)  # CDR, little endian: -0.5 s
store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg(text, "a/msg/A"))
found = {"rosbags": store.deserialize_cdr(data, "a/msg/A")}
for name, schema in (("the whole schema", whole), ("a schema without Duration", text)):
    decoder = DecoderFactory().decoder_for("cdr", Schema(id=1, name="a/msg/A", encoding="ros2msg", data=schema.encode()))
    found[name] = decoder(data)
seen = {name: (one.age.sec, one.kind) for name, one in found.items()}
print(f"mcap-ros2-support {version('mcap-ros2-support')}, rosbags {version('rosbags')}: a Duration of -1 s and a char of 200 are {seen}")
assert seen == {"rosbags": (-1, 200), "the whole schema": (-1, -56), "a schema without Duration": (4294967295, -56)}
PYTHON
