#!/bin/sh
# dbckit's message.decode gives the signals of all pages of a multiplexed message, its decode_frame those of the page that is there; encode writes all too.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet dbckit==1.1.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import dbckit

database = dbckit.parse(
    'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A\n\nBO_ 291 Radar: 8 A\n SG_ Page M : 0|8@1+ (1,0) [0|0] "" A\n'
    ' SG_ Range m0 : 8|16@1+ (0.1,0) [0|0] "m" A\n SG_ Speed m1 : 8|16@1- (0.1,0) [0|0] "m/s" A\n'
)
frame = bytes([1, 0xCE, 0xFF, 0, 0, 0, 0, 0])  # page 1: -5 m/s
seen = {"message.decode": database.message(291).decode(frame), "decode_frame": dbckit.decode_frame(database, 291, frame)}
for name, values in seen.items():
    print(f"dbckit {version('dbckit')}, {name}: {values}")
assert seen == {"message.decode": {"Page": 1.0, "Range": 6548.6, "Speed": -5.0}, "decode_frame": {"Page": 1.0, "Speed": -5.0}}

given = {"Page": 1, "Speed": -5.0, "Range": 10.0}
written = database.message(291).encode(given)
try:
    refused = dbckit.encode_frame(database, 291, given)
except ValueError as error:
    refused = f"ValueError: {error}"
print(f"of {given} message.encode makes {dbckit.decode_frame(database, 291, written)}, encode_frame {refused}")
assert dbckit.decode_frame(database, 291, written)["Speed"] != -5.0 and str(refused).startswith("ValueError")
PYTHON
