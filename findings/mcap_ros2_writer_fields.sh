#!/bin/sh
# mcap-ros2-support writes a misspelt field as 0, and fills up or cuts an array that has not its length: no word of it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mcap-ros2-support==0.6.0
"$folder/venv/bin/pip" install --quiet mcap-ros2-support-fast==0.8.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import io
from importlib.metadata import version

from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer
from mcap_ros2_support_fast.writer import ROS2EncoderFactory

text = "float64 speed\nfloat64[4] covariance\nuint8[<=2] flags\nint32 count\n"
good = {"speed": 1.5, "covariance": [1.0, 2.0, 3.0, 4.0], "flags": [1, 2], "count": 3}
cases = {
    "as defined": good,
    "sped for speed": {"sped": 1.5, **{name: value for name, value in good.items() if name != "speed"}},
    "2 of 4 variances": {**good, "covariance": [1.0, 4.0]},
    "6 of 4 variances": {**good, "covariance": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]},
    "3 of at most 2 flags": {**good, "flags": [1, 2, 3]},
    "a count of 3.9": {**good, "count": 3.9},
}
schema = Schema(id=1, name="a/msg/A", encoding="ros2msg", data=text.encode())
seen = {}
for name, message in cases.items():
    file = io.BytesIO()
    writer = Writer(file)
    writer.write_message("/a", writer.register_msgdef("a/msg/A", text), message, log_time=1, publish_time=1)
    writer.finish()
    file.seek(0)
    back = next(iter(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())).decoded_message
    seen[name] = back.speed, list(back.covariance), list(back.flags), back.count
    try:
        ROS2EncoderFactory().encoder_for(schema)(message)
        other = "written"
    except Exception as error:  # struct's and its own
        other = f"{type(error).__name__}: {error}"
    print(f"mcap-ros2-support {version('mcap-ros2-support')}, {name}: {seen[name]}; mcap-ros2-support-fast {version('mcap-ros2-support-fast')}: {other}")
whole = [1.0, 2.0, 3.0, 4.0]
assert list(seen.values()) == [
    (1.5, whole, [1, 2], 3),
    (0.0, whole, [1, 2], 3),
    (1.5, [1.0, 4.0, 0.0, 0.0], [1, 2], 3),
    (1.5, whole, [1, 2], 3),
    (1.5, whole, [1, 2], 3),
    (1.5, whole, [1, 2], 3),
]
PYTHON
