#!/bin/sh
# canmatrix decodes no frame with an 11-bit id any more, and says nothing, once a DBC file has one J1939 message.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3 cantools==45.1.0 python-can==4.6.1
cd "$folder"
cat > plain.dbc <<'DBC'
VERSION ""
NS_ :
BS_:
BU_: A
BO_ 256 Speed: 8 A
 SG_ speed : 0|16@1+ (0.01,0) [0|0] "m/s" A
BO_ 2565800190 Engine: 8 A
 SG_ rpm : 24|16@1+ (0.125,0) [0|0] "1/min" A
DBC
cat plain.dbc - > j1939.dbc <<'DBC'
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2565800190 3;
DBC
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import can
import canmatrix.formats
import cantools

frame = can.Message(arbitration_id=256, is_extended_id=False, data=bytes.fromhex("e803000000000000"))
seen = {}
for name in ("plain.dbc", "j1939.dbc"):
    decoded = canmatrix.formats.loadp_flat(name).decode_pycan(frame)
    seen[name] = {key: float(value.phys_value) for key, value in decoded.items()}
    right = cantools.database.load_file(name).decode_message(256, frame.data)
    print(f"{name}: canmatrix {version('canmatrix')} {seen[name]}, cantools {version('cantools')} {right}")
    assert right == {"speed": 10.0}
assert seen == {"plain.dbc": {"speed": 10.0}, "j1939.dbc": {}}
PYTHON
