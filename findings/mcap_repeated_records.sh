#!/bin/sh
# An MCAP file without copies of its channels in the summary, as the mcap package's own writer can make it, raises KeyError in its reader and is empty to rosbags.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap==1.6.0
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import Writer
from rosbags.rosbag2 import Reader

# The MCAP specification: copies of schema and channel records in the summary section are optional.
data = bytes((0, 1, 0, 0)) + (2).to_bytes(4, "little") + b"a\0"  # a std_msgs/String in CDR


def read(reader):
    try:
        with open("a.mcap", "rb") as file:
            return len(list(reader(file).iter_messages()))
    except KeyError as error:
        return f"KeyError: {error}"


seen = {}
for off in ("nothing", "repeat_channels", "repeat_schemas"):
    with open("a.mcap", "wb") as file:
        writer = Writer(file, **({} if off == "nothing" else {off: False}))
        writer.start(profile="ros2")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n"))
        writer.add_message(channel, log_time=1, publish_time=1, data=data)
        writer.finish()
    with Reader("a.mcap") as bag:
        seen[off] = read(make_reader), read(NonSeekingReader), len(list(bag.messages()))
    print(
        f"{off} off, messages: mcap {version('mcap')}'s make_reader {seen[off][0]}, NonSeekingReader {seen[off][1]}, "
        f"rosbags {version('rosbags')} {seen[off][2]}"
    )
assert seen == {"nothing": (1, 1, 1), "repeat_channels": ("KeyError: 1", 1, 0), "repeat_schemas": ("KeyError: 1", 1, 1)}
PYTHON
