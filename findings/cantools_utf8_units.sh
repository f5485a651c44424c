#!/bin/sh
# cantools and canmatrix read the unit °/s of a DBC file in UTF-8 as Â°/s unless they are told of the encoding, and cantools writes that.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import canmatrix.formats
import cantools

text = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A\n\nBO_ 256 M: 8 A\n SG_ rate : 0|16@1- (0.01,0) [0|0] "°/s" A\n'
Path("a.dbc").write_text(text, encoding="utf-8")
database = cantools.database.load_file("a.dbc")
cantools.database.dump_file(database, "b.dbc", encoding="utf-8")
seen = {
    "cantools": database.messages[0].signals[0].unit,
    "canmatrix": canmatrix.formats.loadp_flat("a.dbc").frames[0].signals[0].unit,
    "what cantools writes": "Â°/s" in Path("b.dbc").read_text(encoding="utf-8"),
    "cantools, told": cantools.database.load_file("a.dbc", encoding="utf-8").messages[0].signals[0].unit,
}
print(f"cantools {version('cantools')}, canmatrix {version('canmatrix')}: the unit °/s is {seen}")
assert seen == {"cantools": "Â°/s", "canmatrix": "Â°/s", "what cantools writes": True, "cantools, told": "°/s"}
PYTHON
