#!/bin/sh
# rosbags can read neither a message definition with the line ends of Windows nor an MCAP file that has one: it raises.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9 mcap==1.6.0 mcap-ros2-support==0.6.0
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_types_from_msg


def tried(work):
    try:
        return work()
    except Exception as error:  # TypesysError, AnyReaderError
        return f"{type(error).__name__}: {str(error).splitlines()[0]}"


def with_rosbags():
    with AnyReader([Path("a.mcap")]) as reader:
        return [reader.deserialize(data, connection.msgtype).range for connection, _, data in reader.messages()]


def with_mcap():
    with open("a.mcap", "rb") as file:
        return [one.decoded_message.range for one in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()]


for name, end in (("LF", "\n"), ("CR LF", "\r\n")):
    definition = end.join(["uint8 FRONT=1", "uint8 sensor", "float64 range  # m", ""])
    with open("a.mcap", "wb") as file:
        writer = Writer(file)
        writer.write_message("/a", writer.register_msgdef("a_msgs/msg/A", definition), {"sensor": 1, "range": 34.3})
        writer.finish()
    seen = tried(with_mcap), tried(with_rosbags), tried(lambda: sorted(get_types_from_msg(definition, "a_msgs/msg/A")))
    print(f"{name}: mcap-ros2-support {version('mcap-ros2-support')} {seen[0]}; rosbags {version('rosbags')} of the file {seen[1]}, of the text {seen[2]}")
    assert seen[0] == [34.3]
    if end == "\n":
        assert seen[1:] == ([34.3], ["a_msgs/msg/A"])
    else:
        assert seen[1:] == ("AnyReaderError: Could not parse:", "TypesysError: Could not parse:")
PYTHON
