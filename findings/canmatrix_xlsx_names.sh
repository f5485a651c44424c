#!/bin/sh
# A DBC file that canmatrix writes as XLSX comes back without named values and start values, and its float signals as integers.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3
"$folder/venv/bin/pip" install --quiet xlsxwriter==3.3.1 openpyxl==3.1.5
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import canmatrix.formats

Path("a.dbc").write_text("""VERSION ""

NS_ :

BS_:

BU_: A

BO_ 256 M: 8 A
 SG_ speed : 0|16@1- (0.01,0) [-300|300] "m/s" A
 SG_ range : 32|32@1- (1,0) [0|0] "m" A

BA_DEF_ SG_ "GenSigStartValue" FLOAT -100000 100000;
BA_DEF_DEF_ "GenSigStartValue" 0;
BA_ "GenSigStartValue" SG_ 256 speed -500;
VAL_ 256 speed -1 "invalid" 0 "standing" ;
SIG_VALTYPE_ 256 range : 1;
""")
seen = {}
matrix = canmatrix.formats.loadp_flat("a.dbc")
for name in ("a.dbc", "a.xlsx"):
    if name != "a.dbc":
        canmatrix.formats.dumpp({"": matrix}, name)
    (frame,) = canmatrix.formats.loadp_flat(name).frames
    speed, distance = frame.signal_by_name("speed"), frame.signal_by_name("range")
    seen[name] = dict(speed.values), float(speed.initial_value), distance.is_float
print(f"canmatrix {version('canmatrix')}: names, start value, and whether the other signal is a float: {seen}")
assert seen == {"a.dbc": ({-1: "invalid", 0: "standing"}, -5.0, True), "a.xlsx": ({}, 0.0, False)}
PYTHON
