#!/bin/sh
# canmatrix cannot read the FIBEX file that it writes of a plain DBC.
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
open("a.dbc", "w").write('VERSION ""\nNS_ :\nBS_:\nBU_: A B\nBO_ 291 M: 8 A\n SG_ range : 0|12@1+ (0.05,0) [0|204.75] "m" B\n')
canmatrix.formats.dumpp({"": canmatrix.formats.loadp_flat("a.dbc")}, "a.xml")
try:
    seen = str([frame.name for frame in canmatrix.formats.loadp_flat("a.xml").frames])
except KeyError as error:
    seen = f"KeyError: {error}"
print(f"canmatrix {version('canmatrix')}: read back from FIBEX: {seen}")
assert seen == "KeyError: 'PDUINST_M.range'"
PYTHON
