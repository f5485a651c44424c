#!/bin/sh
# mcap-ros2idl-support raises at the bounds in a ROS 2 definition, float64[<=3] or string<=8, and at arrays of byte or char: it reads no such message.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0 mcap-ros2-support==0.6.0 mcap-ros2idl-support==0.2.0
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from mcap_ros2idl_support import Ros2DecodeFactory

# The first as shape_msgs/SolidPrimitive has its dimensions.
messages = {
    "uint8 type\nfloat64[<=3] dimensions\n": {"type": 1, "dimensions": [1.0, 2.0, 3.0]},
    "string<=8 name\n": {"name": "front"},
    "byte[] raw\n": {"raw": [1, 2]},
    "char[2] raw\n": {"raw": [1, 2]},
    "uint8 type\nfloat64[] dimensions\nfloat64[3] size\nstring name\n": {"type": 1, "dimensions": [1.0], "size": [1.0, 2.0, 3.0], "name": "front"},
}
for definition, message in messages.items():
    with open("a.mcap", "wb") as file:
        writer = Writer(file)
        writer.write_message("/a", writer.register_msgdef("a_msgs/msg/A", definition), message)
        writer.finish()
    seen = {}
    for name, factory in (("mcap-ros2-support", DecoderFactory), ("mcap-ros2idl-support", Ros2DecodeFactory)):
        with open("a.mcap", "rb") as file:
            try:
                (decoded,) = [one.decoded_message for one in make_reader(file, decoder_factories=[factory()]).iter_decoded_messages()]
                seen[name] = decoded if isinstance(decoded, dict) else {field: getattr(decoded, field) for field in message}
            except ValueError as error:
                seen[name] = f"ValueError: {error}"
    print(f"{definition.split()}: " + "; ".join(f"{name} {version(name)}: {found}" for name, found in seen.items()))
    assert seen["mcap-ros2-support"] == message or list(seen["mcap-ros2-support"]["raw"]) == message["raw"]
    if "raw" in definition:
        assert seen["mcap-ros2idl-support"] == f"ValueError: Unrecognized primitive type {definition[:4]}"
    elif "<=" in definition:
        assert seen["mcap-ros2idl-support"].startswith("ValueError: Expected 1 top level type definition for '")
    else:
        assert {field: list(found) if isinstance(found, (list, tuple)) else found for field, found in seen["mcap-ros2idl-support"].items()} == message
PYTHON
