#!/bin/sh
# canmatrix's cancompare finds no difference where a signal became a float, a message CAN FD or half as frequent, or a signal came onto more pages.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet canmatrix==1.3.3
cd "$folder"
venv/bin/python - <<'PYTHON'
import subprocess
from importlib.metadata import version

frames = "StandardCAN ExtendedCAN r2 J1939PG r4 r5 r6 r7 r8 r9 r10 r11 r12 r13 StandardCAN_FD ExtendedCAN_FD".split()
text = f"""VERSION ""
NS_ :
BS_:
BU_: A B
BO_ 291 M: 8 A
 SG_ page M : 0|8@1+ (1,0) [0|255] "" B
 SG_ range m0 : 8|32@1- (1,0) [0|0] "m" B
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;
BA_DEF_ BO_ "VFrameFormat" ENUM {",".join(f'"{name}"' for name in frames)};
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "GenMsgCycleTime" BO_ 291 50;
BA_ "VFrameFormat" BO_ 291 0;
SG_MUL_VAL_ 291 range page 0-0;
"""
changes = {
    "another unit": ('"m"', '"cm"'),
    "another scale": ("8|32@1- (1,0)", "8|32@1- (0.1,0)"),
    "a float": ("SG_MUL_VAL_", "SIG_VALTYPE_ 291 range : 1;\nSG_MUL_VAL_"),
    "CAN FD": ('"VFrameFormat" BO_ 291 0;', '"VFrameFormat" BO_ 291 14;'),
    "every 100 ms": ("BO_ 291 50;", "BO_ 291 100;"),
    "pages 0 to 3": ("page 0-0;", "page 0-3;"),
}
open("a.dbc", "w").write(text)
seen = {}
for name, (old, new) in changes.items():
    open("b.dbc", "w").write(text.replace(old, new))
    done = subprocess.run(["venv/bin/cancompare", "a.dbc", "b.dbc"], capture_output=True, text=True, check=True)
    seen[name] = done.stdout.split()
    print(f"canmatrix {version('canmatrix')}, {name}: cancompare says {' '.join(seen[name]) or 'nothing'!r}")
assert [bool(said) for said in seen.values()] == [True, True, False, False, False, False]
PYTHON
