#!/bin/sh
# dbckit reads the decimal numbers of an ASC file as hexadecimal: 34.3 m of message 291 become 39.1 m of message 0x291. CAN FD frames it leaves out.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet dbckit==1.1.1
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import can
import dbckit

# One frame with the id 291, 0x123, and the bytes 87 and 1: 343 steps of 0.1 m.
database = dbckit.parse(
    'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A\n\n'
    + "".join(f'BO_ {number} Radar{number}: 8 A\n SG_ Range : 0|16@1+ (0.1,0) [0|0] "m" A\n\n' for number in (291, 0x291))
)
files = {
    "hex": ("hex", "   0.010000 1  123             Rx   d 8 57 01 00 00 00 00 00 00"),
    "decimal": ("dec", "   0.010000 1  291             Rx   d 8 87 01 00 00 00 00 00 00"),
    "CAN FD": ("hex", "   0.010000 CANFD   1 Rx  123  Radar291  0 0 8  8 57 01 00 00 00 00 00 00  0 0 1000 0 0 0 0 0"),
}
seen = {}
for name, (base, line) in files.items():
    with open("a.asc", "w") as file:
        file.write(f"date Sun Sep 13 12:26:40.000 2020\nbase {base}  timestamps absolute\nno internal events logged\n{line}\n")
    with can.ASCReader("a.asc") as reader:
        assert [(message.arbitration_id, bytes(message.data[:2])) for message in reader] == [(291, b"\x57\x01")]
    seen[name] = [(frame.arbitration_id, round(frame.signals["Range"], 1)) for frame in dbckit.decode_log(database, "a.asc")]
    print(f"dbckit {version('dbckit')}, {name}: {seen[name]}; python-can {can.__version__} reads the frame 291 with 34.3 m")
assert seen == {"hex": [(291, 34.3)], "decimal": [(0x291, 39.1)], "CAN FD": []}
PYTHON
