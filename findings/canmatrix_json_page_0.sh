#!/bin/sh
# canmatrix's JSON, with all it can hold, loses the page of signals on page 0: they are read out of every frame.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3
cd "$folder"
venv/bin/python - <<'PYTHON'
import logging
from importlib.metadata import version

import canmatrix.formats

logging.disable(logging.CRITICAL)
open("a.dbc", "w").write(
    'VERSION ""\nNS_ :\nBS_:\nBU_: A B\nBO_ 292 M: 8 A\n SG_ page M : 0|8@1+ (1,0) [0|255] "" B\n'
    ' SG_ range m0 : 8|8@1+ (0.5,0) [0|127.5] "m" B\n SG_ azimuth m1 : 8|8@1- (1,0) [-128|127] "deg" B\n'
)
loaded = canmatrix.formats.loadp_flat("a.dbc")
canmatrix.formats.dumpp({"": loaded}, "a.json", jsonExportAll=True)
seen = []
for matrix in (loaded, canmatrix.formats.loadp_flat("a.json")):
    found = matrix.frames[0].decode(bytes((1, 200, 0, 0, 0, 0, 0, 0)))
    seen.append({name: float(value.phys_value) for name, value in found.items()})
print(f"canmatrix {version('canmatrix')}: a frame of page 1 by its DBC file: {seen[0]}; by the JSON written of it: {seen[1]}")
assert seen[0] == {"page": 1.0, "azimuth": -56.0}
assert seen[1] == {"page": 1.0, "range": 100.0, "azimuth": -56.0}
PYTHON
