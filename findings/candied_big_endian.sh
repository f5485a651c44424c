#!/bin/sh
# candied takes the start of a big-endian signal in a DBC file for its end: 50 m are NaN. A value beyond the maximum, such as a named one, is the maximum.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
cd "$folder"
npm install --silent --no-save --no-audit --no-fund candied@2.2.0
cat > a.dbc <<'DBC'
VERSION ""
NS_ :
BS_:
BU_: A
BO_ 256 M: 8 A
 SG_ first : 7|16@0+ (0.1,0) [0|6553.5] "m" A
 SG_ second : 23|12@0- (1,0) [-2048|2047] "" A
 SG_ third : 47|8@0+ (1,0) [0|255] "" A
 SG_ range : 48|8@1+ (0.1,0) [0|20] "m" A
VAL_ 256 range 255 "invalid" ;
DBC
cat > seen.js <<'NODE'
const fs = require('fs');
const { Can, Dbc } = require('candied');
const can = new Can();
can.database = new Dbc().load(fs.readFileSync('a.dbc', 'utf8'));
// 50 m, -221, 42 and a range that is said to be invalid.
const frame = can.createFrame(256, [0x01, 0xf4, 0xf2, 0x30, 0x00, 0x2a, 0xff, 0x00]);
const seen = {};
for (const [name, signal] of can.decode(frame).boundSignals) seen[name] = [String(signal.value), signal.physValue];
console.log(JSON.stringify(seen));
NODE
node seen.js > seen.json
venv/bin/python - <<'PYTHON'
import json
from importlib.metadata import version

import cantools

with open("seen.json") as file:
    found = json.load(file)
data = bytes.fromhex("01f4f230002aff00")
right = {name: str(value) for name, value in cantools.database.load_file("a.dbc").decode_message(256, data).items()}
print(f"cantools {version('cantools')}: {right}")
print(f"candied 2.2.0, value and text: {found}")
assert right == {"first": "50.0", "second": "-221", "third": "42", "range": "invalid"}
assert [found[name][0] for name in ("first", "second", "third")] == ["NaN", "1001", "0"]
assert found["range"] == ["20", "20 m"]
PYTHON
