#!/bin/sh
# A signal that a DBC file has on several pages (SG_MUL_VAL_) is on the first one alone in the KCD that cantools writes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import cantools

text = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 301 M: 8 A
 SG_ page M : 0|8@1+ (1,0) [0|0] "" A
 SG_ range m0 : 8|8@1+ (0.5,0) [0|0] "m" A
 SG_ azimuth m4 : 8|8@1- (1,0) [0|0] "deg" A
SG_MUL_VAL_ 301 range page 0-3;
SG_MUL_VAL_ 301 azimuth page 4-7;
"""
database = cantools.database.load_string(text, "dbc")
again = cantools.database.load_string(database.as_kcd_string(), "kcd")
seen = []
for one in (database, again):
    pages = {}
    for page in (0, 2, 4):
        try:
            pages[page] = sorted(one.decode_message("M", bytes((page, 10, 0, 0, 0, 0, 0, 0))))
        except cantools.database.DecodeError as error:
            pages[page] = f"DecodeError: {error}"
    seen.append(pages)
print(f"cantools {cantools.__version__}: signals by page, as loaded: {seen[0]}; written as KCD and read back: {seen[1]}")
assert seen[0] == {0: ["page", "range"], 2: ["page", "range"], 4: ["azimuth", "page"]}
assert seen[1][0] == seen[0][0] and seen[1][4] == seen[0][4] and seen[1][2].startswith("DecodeError")
PYTHON
