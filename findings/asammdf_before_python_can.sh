#!/bin/sh
# Where canopen is installed and asammdf is imported before python-can, python-can says that there is no asammdf: it reads and writes no MF4.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet asammdf==8.8.28 canmatrix==1.2 python-can==4.6.1
cd "$folder"
cat > seen.py <<'PYTHON'
import importlib
import sys

for name in sys.argv[1].split(","):
    importlib.import_module(name)
import can
import canmatrix.formats

try:
    with can.MF4Writer("a.mf4") as writer:
        writer.on_message_received(can.Message(timestamp=1.6e9, arbitration_id=0x100, is_extended_id=False, data=b"\x01"))
    said = f"{len(list(can.LogReader('a.mf4')))} frame"
except NotImplementedError as error:
    said = str(error).split(".")[0]
print(f"{said}; canmatrix has {'EDS' if 'eds' in canmatrix.formats.supportedFormats else 'no EDS'}")
PYTHON
said() {
    found=$(venv/bin/python -W ignore seen.py "$1" 2> errors) || { cat errors >&2; exit 1; }
    echo "$2: import $1: $found"
    [ "$found" = "$3" ]
}
said can,asammdf 'asammdf 8.8.28 and python-can 4.6.1' '1 frame; canmatrix has no EDS'
said asammdf,can 'asammdf 8.8.28 and python-can 4.6.1' '1 frame; canmatrix has no EDS'
venv/bin/pip install --quiet canopen==2.4.1
# asammdf imports canmatrix, that imports canopen for EDS files, that python-can, and that asammdf, which is not done yet.
said asammdf,can 'with canopen 2.4.1' 'The asammdf package was not found; canmatrix has EDS'
said can,asammdf 'with canopen 2.4.1' '1 frame; canmatrix has no EDS'
