#!/bin/sh
# opendbc's CANPacker takes a value that a signal has no room for, and sends another: 200 m are 72 m; cantools raises.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pycapnp==2.1.0 tqdm==4.70.1 cantools==45.1.0
"$folder/venv/bin/pip" install --quiet --no-deps --ignore-requires-python opendbc==0.3.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

import cantools
from opendbc.can import CANPacker

Path("a.dbc").write_text(
    'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 292 M: 8 A\n SG_ range : 0|8@1+ (0.5,0) [0|127.5] "m" A\n'
    ' SG_ azimuth : 8|8@1- (1,0) [-128|127] "deg" A\n'
)
values = {"range": 200, "azimuth": 150}
_, data, _ = CANPacker(str(Path("a.dbc").resolve())).make_can_msg("M", 0, values)
database = cantools.database.load_file("a.dbc")
back = database.decode_message("M", data)
try:
    said = str(database.encode_message("M", values))
except cantools.database.EncodeError as error:
    said = str(error)
print(f"opendbc {version('opendbc')}: {values} are sent as {back}; cantools {version('cantools')}: {said}")
assert back == {"range": 72.0, "azimuth": -106}
assert "127.5" in said
PYTHON
