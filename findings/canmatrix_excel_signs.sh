#!/bin/sh
# canmatrix's Excel files keep no signs: read back, a signed signal is unsigned, and its minimum is its offset (XLSX) or no offset is left (XLS).
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3
"$folder/venv/bin/pip" install --quiet openpyxl==3.1.5 xlrd==2.0.2 xlwt==1.3.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import logging
from importlib.metadata import version

import canmatrix.formats

logging.disable(logging.CRITICAL)
open("a.dbc", "w").write(
    'VERSION ""\nNS_ :\nBS_:\nBU_: A B\nBO_ 291 M: 8 A\n SG_ azimuth : 0|12@1- (0.05,0) [-102.4|102.35] "deg" B\n'
    ' SG_ range : 16|16@1+ (0.01,1.5) [1.5|656.85] "m" B\n'
)
loaded = canmatrix.formats.loadp_flat("a.dbc")
data = bytes((0x38, 0x0F, 0xE8, 0x03, 0, 0, 0, 0))  # azimuth 0xF38 = -200 steps, range 1000 steps
seen = {}
for name in ("a.dbc", "a.xlsx", "a.xls"):
    canmatrix.formats.dumpp({"": loaded}, name)
    canmatrix.formats.dumpp({"": canmatrix.formats.loadp_flat(name)}, "back.dbc")
    found = canmatrix.formats.loadp_flat("back.dbc").frames[0].decode(data)
    seen[name] = {signal: float(found[signal].phys_value) for signal in ("azimuth", "range")}
    print(f"canmatrix {version('canmatrix')}: -10 deg and 11.5 m, by the DBC file that comes back from {name}: {seen[name]}")
assert seen["a.dbc"] == {"azimuth": -10.0, "range": 11.5}
assert seen["a.xlsx"] == {"azimuth": 92.4, "range": 11.5}
assert seen["a.xls"] == {"azimuth": 194.8, "range": 10.0}
PYTHON
