#!/bin/sh
# cantools gives a value that has a name unscaled: 4095 where the signal's own unit has 409.5 m.
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
 SG_ range : 0|12@1+ (0.1,0) [0|409.5] "m" A
VAL_ 301 range 4095 "none" 4000 "far" ;
"""
message = cantools.database.load_string(text, "dbc").get_message_by_name("M")
seen = {}
for raw in (3999, 4000):
    data = raw.to_bytes(8, "little")
    value, number = message.decode(data)["range"], message.decode(data, decode_choices=False)["range"]
    seen[raw] = getattr(value, "value", value), number
print(f"cantools {cantools.__version__}: value as decoded, and with decode_choices=False, in m: {seen}")
assert [round(number, 6) for number in seen[3999]] == [399.9, 399.9] and seen[4000] == (4000, 400.0)
PYTHON
