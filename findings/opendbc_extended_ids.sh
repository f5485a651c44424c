#!/bin/sh
# opendbc's CANParser wants an extended frame's address with the DBC file's bit 31, and drops the 29-bit id that a bus has.
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

identifier = 0x18FEF100
Path("a.dbc").write_text(f'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ {1 << 31 | identifier} M: 8 A\n SG_ speed : 0|8@1+ (1,0) [0|0] "m/s" A\n')
seen = []
for address in (identifier, 1 << 31 | identifier):
    parser = CANParser(str(Path("a.dbc").resolve()), [("M", 0)], 0)
    parser.update([(1_000_000_000, [(address, bytes((7,) * 8), 0)])])
    seen.append(parser.vl["M"]["speed"])
print(f"opendbc {version('opendbc')}: a speed of 7 m/s under the id 0x{identifier:X} gives {seen[0]}, under 0x{1 << 31 | identifier:X} {seen[1]}")
assert seen == [0.0, 7.0]
PYTHON
