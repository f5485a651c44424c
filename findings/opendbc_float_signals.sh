#!/bin/sh
# opendbc's CANParser gives the bits of a float signal (SIG_VALTYPE_) as an integer.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet numpy==2.4.6 pycapnp==2.1.0 tqdm==4.70.1
"$folder/venv/bin/pip" install --quiet --no-deps --ignore-requires-python opendbc==0.3.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import struct
from importlib.metadata import version
from pathlib import Path

from opendbc.can import CANParser

Path("a.dbc").write_text('VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 291 M: 8 A\n SG_ range : 0|32@1- (1,0) [0|0] "m" A\nSIG_VALTYPE_ 291 range : 1;\n')
parser = CANParser(str(Path("a.dbc").resolve()), [("M", 0)], 0)
parser.update([(1_000_000_000, [(291, struct.pack("<f4x", 3.5), 0)])])
seen = parser.vl["M"]["range"]
print(f"opendbc {version('opendbc')}: a float32 signal of 3.5 m is {seen}")
assert seen == float(struct.unpack("<i", struct.pack("<f", 3.5))[0])
PYTHON
