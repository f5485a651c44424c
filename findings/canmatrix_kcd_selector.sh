#!/bin/sh
# canmatrix neither writes nor reads the byte order of a multiplexer in KCD: a big-endian page 1 is page 256, with no signals on it.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3 lxml==6.1.3
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import logging
from importlib.metadata import version

import canmatrix.formats
import cantools

logging.disable(logging.CRITICAL)
open("a.dbc", "w").write(
    'VERSION ""\nNS_ :\nBS_:\nBU_: A B\nBO_ 292 M: 8 A\n SG_ page M : 7|16@0+ (1,0) [0|65535] "" B\n'
    ' SG_ range m1 : 23|16@0+ (0.01,0) [0|655.35] "m" B\n SG_ azimuth m2 : 23|16@0- (0.01,0) [-327.68|327.67] "deg" B\n'
)
canmatrix.formats.dumpp({"": canmatrix.formats.loadp_flat("a.dbc")}, "canmatrix.kcd")
cantools.database.dump_file(cantools.database.load_file("a.dbc"), "cantools.kcd")
data = bytes((0, 1, 0x03, 0xE8, 0, 0, 0, 0))  # page 1, a range of 10 m
seen = {}
for name in ("a.dbc", "cantools.kcd", "canmatrix.kcd"):
    try:
        ours = cantools.database.load_file(name).messages[0].decode(data)
    except cantools.database.DecodeError as error:
        ours = f"DecodeError: {error}"
    found = canmatrix.formats.loadp_flat(name).frames[0].decode(data)
    seen[name] = ours, {signal: float(one.phys_value) for signal, one in found.items()}
    print(f"{name}: cantools {cantools.__version__} {ours}, canmatrix {version('canmatrix')} {seen[name][1]}")
right = {"page": 1, "range": 10.0}
assert seen["a.dbc"] == (right, right)
assert seen["cantools.kcd"] == (right, {"page": 256.0})
assert seen["canmatrix.kcd"] == ("DecodeError: expected multiplexer id 1 or 2, but got 256", {"page": 256.0})
PYTHON
