#!/bin/sh
# @foxglove/rosmsg reads the constants 0b101 and 0o17 of a ROS 2 definition as 0, where ROS's parser, in mcap-ros2-support, and ros-parser have 5 and 15.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap-ros2-support==0.6.0 ros-parser==0.9.0
cd "$folder"
npm install --silent --no-save --no-audit --no-fund @foxglove/rosmsg@5.0.5
cat > seen.js <<'NODE'
const { parse } = require('@foxglove/rosmsg');
const definition = 'uint8 PLAIN=5\nuint8 HEX=0x1F\nuint8 BINARY=0b101\nuint8 OCTAL=0o17\nuint8 state\n';
const constants = parse(definition, { ros2: true })[0].definitions.filter((field) => field.isConstant);
console.log(JSON.stringify({ definition, seen: Object.fromEntries(constants.map((field) => [field.name, field.value])) }));
NODE
node seen.js > seen.json
venv/bin/python - <<'PYTHON'
import json
from importlib.metadata import version

from mcap_ros2._vendor.rosidl_adapter.parser import parse_message_string
from ros_parser import ros2_msg

with open("seen.json") as file:
    theirs = json.load(file)
seen = {
    "@foxglove/rosmsg 5.0.5": theirs["seen"],
    f"ROS's parser in mcap-ros2-support {version('mcap-ros2-support')}": {
        constant.name: constant.value for constant in parse_message_string("a_msgs", "A", theirs["definition"]).constants
    },
    f"ros-parser {version('ros-parser')}": {
        constant.name: constant.value for constant in ros2_msg.parse_message_string(theirs["definition"]).constants
    },
}
for name, found in seen.items():
    print(f"{name}: {found}")
right = {"PLAIN": 5, "HEX": 31, "BINARY": 5, "OCTAL": 15}
assert list(seen.values()) == [right | {"BINARY": 0, "OCTAL": 0}, right, right]
PYTHON
