#!/bin/sh
# canmatrix's encode takes a number for what goes on the bus, and the same number as text for the signal's value: of 20 m/s its decode gives back 0.2, of "20" 20.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3 cantools==45.1.0
cd "$folder"
cat > a.dbc <<'DBC'
VERSION ""
NS_ :
BS_:
BU_: A
BO_ 256 Speed: 8 A
 SG_ speed : 0|16@1+ (0.01,0) [0|655.35] "m/s" A
 SG_ yaw_rate : 16|16@1- (0.01,0) [-327.68|327.67] "deg/s" A
DBC
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import canmatrix
import canmatrix.formats
import cantools

matrix = canmatrix.formats.loadp_flat("a.dbc")
number = canmatrix.ArbitrationId(256, extended=False)
cases = {"numbers": {"speed": 20.0, "yaw_rate": -5.6}, "text": {"speed": "20.0", "yaw_rate": "-5.6"}}
sent = {"cantools": cantools.database.load_file("a.dbc").encode_message(256, cases["numbers"])}
sent |= {name: bytes(matrix.encode(number, values)) for name, values in cases.items()}
seen = {}
for name, data in sent.items():
    seen[name] = {key: float(value.phys_value) for key, value in matrix.decode(number, data).items()}
    maker = f"cantools {version('cantools')}" if name == "cantools" else f"canmatrix {version('canmatrix')} of {cases[name]}"
    print(f"{maker}: {data.hex()}, which canmatrix decodes as {seen[name]}")
assert seen["cantools"] == seen["text"] == {"speed": 20.0, "yaw_rate": -5.6}
assert seen["numbers"] == {"speed": 0.2, "yaw_rate": -0.06}
PYTHON
