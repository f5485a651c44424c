#!/bin/sh
# rosbags reads a ROS 2 byte as signed, -56 for 200, and an array of them that it types as uint8 as int8; mcap-ros2-support says 200.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9
"$folder/venv/bin/pip" install --quiet mcap-ros2-support==0.6.0
"$folder/venv/bin/pip" install --quiet numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

text = "byte one\nbyte[] many\n"
data = bytes((0, 1, 0, 0)) + bytes((200, 0, 0, 0)) + bytes((1, 0, 0, 0)) + bytes((200,))  # CDR, little endian
store = get_typestore(Stores.ROS2_JAZZY)
store.register(get_types_from_msg(text, "a/msg/A"))
ours = store.deserialize_cdr(data, "a/msg/A")
theirs = DecoderFactory().decoder_for("cdr", Schema(id=1, name="a/msg/A", encoding="ros2msg", data=text.encode()))(data)
print(
    f"rosbags {version('rosbags')}: byte {ours.one}, array {ours.many.tolist()} of {ours.many.dtype}, declared {type(ours).__annotations__['many']}; "
    f"mcap-ros2-support {version('mcap-ros2-support')}: {theirs.one}, {list(theirs.many)}"
)
assert (ours.one, ours.many.tolist(), str(ours.many.dtype)) == (-56, [-56], "int8")
assert "uint8" in str(type(ours).__annotations__["many"]) and (theirs.one, list(theirs.many)) == (200, [200])
PYTHON
