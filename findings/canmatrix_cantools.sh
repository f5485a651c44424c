#!/bin/sh
# cantools reads neither the ARXML nor the SYM that canmatrix writes of a plain DBC.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.2
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
"$folder/venv/bin/pip" install --quiet lxml==6.0.2
cd "$folder"
venv/bin/python - <<'PYTHON'
import logging
from importlib.metadata import version

import canmatrix.formats
import cantools

logging.disable(logging.CRITICAL)
open("a.dbc", "w").write('VERSION ""\nNS_ :\nBS_:\nBU_: A B\nBO_ 291 M: 8 A\n SG_ speed : 0|16@1+ (0.01,0) [0|655.35] "m/s" B\n')
matrices = canmatrix.formats.loadp("a.dbc")
seen = {}
for kind in ("arxml", "sym", "dbc"):
    canmatrix.formats.dumpp(matrices, f"b.{kind}")
    try:
        seen[kind] = f"messages {[message.name for message in cantools.database.load_file(f'b.{kind}').messages]}"
    except cantools.database.UnsupportedDatabaseFormatError as error:
        seen[kind] = f"{error}"
    print(f"canmatrix {version('canmatrix')}, cantools {cantools.__version__}: {kind}: {seen[kind]}")
assert "does not exist" in seen["arxml"] and "Only SYM version 6.0" in seen["sym"] and seen["dbc"] == "messages ['M']"
PYTHON
