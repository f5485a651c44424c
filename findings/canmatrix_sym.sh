#!/bin/sh
# canmatrix writes a float signal into SYM as an integer, and reads of the SYM that cantools writes frames without a byte or a signal.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import logging
import struct
from importlib.metadata import version

import canmatrix.formats
import cantools

logging.disable(logging.CRITICAL)
text = 'VERSION ""\nNS_ :\nBS_:\nBU_: A B\nBO_ 291 M: 8 A\n SG_ range : 0|32@1- (1,0) [0|0] "m" B\nSIG_VALTYPE_ 291 range : 1;\n'
open("a.dbc", "w").write(text)
canmatrix.formats.dumpp({"": canmatrix.formats.loadp_flat("a.dbc")}, "a.sym")
database = cantools.database.load_string(text, "dbc")
cantools.database.dump_file(database, "b.sym")
data = struct.pack("<f4x", 3.5)
seen = {}
for name in ("a.dbc", "a.sym"):
    seen[name] = float(canmatrix.formats.loadp_flat(name).frames[0].decode(data)["range"].phys_value)
(frame,) = canmatrix.formats.loadp_flat("b.sym").frames
other = cantools.database.load_file("b.sym").get_message_by_name("M")
print(f"canmatrix {version('canmatrix')}: a float32 of 3.5 m, by the DBC file and by the SYM file written of it: {seen}")
print(
    f"of cantools {cantools.__version__}'s SYM file canmatrix reads a frame of {frame.size} bytes with {len(frame.signals)} signals, "
    f"cantools one of {other.length} with {len(other.signals)}"
)
assert seen == {"a.dbc": 3.5, "a.sym": float(struct.unpack("<i", struct.pack("<f", 3.5))[0])}
assert (frame.size, len(frame.signals)) == (0, 0) and (other.length, len(other.signals)) == (8, 1)
PYTHON
