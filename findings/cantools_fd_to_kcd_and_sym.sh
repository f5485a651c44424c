#!/bin/sh
# cantools writes a CAN FD message as KCD or SYM without saying so: read back, its 64 bytes are a classic frame's.
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
BO_ 291 M: 64 A
 SG_ far : 384|16@1+ (1,0) [0|0] "" A
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","r2","J1939PG","r4","r5","r6","r7","r8","r9","r10","r11","r12","r13","StandardCAN_FD";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 291 14;
"""
database = cantools.database.load_string(text, "dbc")
seen = {"as loaded": (database.messages[0].is_fd, database.messages[0].length)}
for kind, written in (("dbc", database.as_dbc_string()), ("kcd", database.as_kcd_string()), ("sym", database.as_sym_string())):
    message = cantools.database.load_string(written, kind).messages[0]
    seen[kind] = message.is_fd, message.length
print(f"cantools {cantools.__version__}: is_fd and length, by format written and read back: {seen}")
assert seen == {"as loaded": (True, 64), "dbc": (True, 64), "kcd": (False, 64), "sym": (False, 64)}
PYTHON
