#!/bin/sh
# opendbc's CANParser reads every multiplexed signal out of every frame, whatever the selector says.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pycapnp==2.1.0 tqdm==4.70.1
"$folder/venv/bin/pip" install --quiet --no-deps --ignore-requires-python opendbc==0.3.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version
from pathlib import Path

from opendbc.can import CANParser

Path("a.dbc").write_text(
    'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 292 M: 8 A\n SG_ page M : 0|8@1+ (1,0) [0|0] "" A\n'
    ' SG_ range m0 : 8|8@1+ (0.5,0) [0|0] "m" A\n SG_ azimuth m1 : 8|8@1- (1,0) [0|0] "deg" A\n'
)
parser = CANParser(str(Path("a.dbc").resolve()), [("M", 0)], 0)
parser.update([(1_000_000_000, [(292, bytes((0, 200, 0, 0, 0, 0, 0, 0)), 0)])])
seen = dict(parser.vl["M"])
print(f"opendbc {version('opendbc')}: a frame of page 0, which has a range alone, gives {seen}")
assert seen == {"page": 0.0, "range": 100.0, "azimuth": -56.0}
PYTHON
