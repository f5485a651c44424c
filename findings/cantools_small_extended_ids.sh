#!/bin/sh
# cantools decode reads a frame with the 29-bit id 0x123 by the message of the 11-bit id 0x123, and does not find its own.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import subprocess
import sys

import cantools

standard = 'BO_ 291 Standard: 8 A\n SG_ a : 0|8@1+ (1,0) [0|0] "" A\n'
extended = f'BO_ {291 | 1 << 31} Extended: 8 A\n SG_ b : 0|8@1+ (1,0) [0|0] "" A\n'
seen = {}
for name, messages in (("both", standard + extended), ("extended alone", extended)):
    open("a.dbc", "w").write(f'VERSION ""\nNS_ :\nBS_:\nBU_: A\n{messages}')
    line = "(1600000000.000000) can0 00000123#0500000000000000\n"  # candump: eight digits are a 29-bit id
    command = [sys.executable, "-m", "cantools", "decode", "--single-line", "a.dbc"]
    told = subprocess.run(command, input=line, capture_output=True, text=True, check=True).stdout.strip().partition(" :: ")[2]
    database = cantools.database.load_file("a.dbc")
    seen[name] = told, database.decode_message(291, bytes((5,) + (0,) * 7), force_extended_id=True)
    print(f"cantools {cantools.__version__}, {name}: cantools decode says {seen[name][0]!r}, with force_extended_id {seen[name][1]}")
assert seen["both"] == ("Standard(a: 5)", {"b": 5})
assert seen["extended alone"] == ("Unknown frame id 291 (0x123)", {"b": 5})
PYTHON
