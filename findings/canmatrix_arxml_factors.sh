#!/bin/sh
# canmatrix writes a signal's scale and offset into ARXML with one digit behind the point: 0.05 becomes 0.1, and 0.01 becomes 1.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3
"$folder/venv/bin/pip" install --quiet lxml==6.1.3
cd "$folder"
venv/bin/python - <<'PYTHON'
import logging
from importlib.metadata import version

import canmatrix.formats

logging.disable(logging.CRITICAL)
open("a.dbc", "w").write(
    'VERSION ""\nNS_ :\nBS_:\nBU_: A B\nBO_ 291 M: 8 A\n SG_ range : 0|12@1+ (0.05,0) [0|204.75] "m" B\n'
    ' SG_ azimuth : 12|12@1- (0.01,0.25) [-20.23|20.72] "deg" B\n'
)
loaded = canmatrix.formats.loadp_flat("a.dbc")
canmatrix.formats.dumpp({"": loaded}, "a.arxml")
data = (2000 | (1500 << 12)).to_bytes(8, "little")
seen = []
for matrix in (loaded, canmatrix.formats.loadp_flat("a.arxml")):
    found = matrix.frames[0].decode(data)
    seen.append({name: float(found[name].phys_value) for name in ("range", "azimuth")})
print(f"canmatrix {version('canmatrix')}: one frame decoded as the DBC says: {seen[0]}, and as the ARXML written of it says: {seen[1]}")
assert seen[0] == {"range": 100.0, "azimuth": 15.25}
assert seen[1] == {"range": 200.0, "azimuth": 1500.2}
PYTHON
