#!/bin/sh
# @foxglove/omgidl-serialization reads lists of structs and of strings in XCDR2 without the length before them: pycdr2's messages raise or come out shifted.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pycdr2==1.0.0
cd "$folder"
npm install --silent --no-save --no-audit --no-fund @foxglove/omgidl-parser@1.1.0 @foxglove/omgidl-serialization@1.0.3
venv/bin/python - <<'PYTHON'
import json
from dataclasses import dataclass

from pycdr2 import IdlStruct
from pycdr2.types import array, int32, sequence


@dataclass
class Point(IdlStruct, typename="Point"):
    x: int32


@dataclass
class Numbers(IdlStruct, typename="Numbers"):
    list: sequence[int32]
    end: int32


@dataclass
class Points(IdlStruct, typename="Points"):
    list: sequence[Point]
    end: int32


@dataclass
class Pair(IdlStruct, typename="Pair"):
    list: array[Point, 2]
    end: int32


@dataclass
class Names(IdlStruct, typename="Names"):
    list: sequence[str]
    end: int32


messages = [Numbers([1, 2], 7), Points([Point(1), Point(2)], 7), Pair([Point(1), Point(2)], 7), Names(["a", "b"], 7)]
made = {}
for message in messages:
    for kind, two in (("XCDR1", False), ("XCDR2", True)):
        data = message.serialize(use_version_2=two)
        assert type(message).deserialize(data) == message
        made[f"{type(message).__name__} {kind}"] = data.hex()
# A list of what is no number has its length in bytes before it: DDS-XTypes 1.3, 7.4.3.5.3.
assert made["Points XCDR2"] == "00070000" + "0c000000" + "02000000" + "01000000" + "02000000" + "07000000"
with open("made.json", "w") as file:
    json.dump(made, file)
PYTHON
cat > seen.js <<'NODE'
const assert = require('node:assert');
const { readFileSync } = require('node:fs');
const { parseIDL } = require('@foxglove/omgidl-parser');
const { MessageReader } = require('@foxglove/omgidl-serialization');

const definition = parseIDL(`@final struct Point { int32 x; }; @final struct Numbers { sequence<int32> list; int32 end; };
  @final struct Points { sequence<Point> list; int32 end; }; @final struct Pair { Point list[2]; int32 end; };
  @final struct Names { sequence<string> list; int32 end; };`);
const seen = {};
for (const [name, hex] of Object.entries(JSON.parse(readFileSync('made.json')))) {
  try {
    const { list, end } = new MessageReader(name.split(' ')[0], definition).readMessage(Buffer.from(hex, 'hex'));
    seen[name] = `${Array.from(list, (one) => one.x ?? one)} and ${end}`;
  } catch (error) {
    seen[name] = error.name;
  }
  console.log(`pycdr2 1.0.0 wrote ${name}; @foxglove/omgidl-serialization 1.0.3 reads ${seen[name]}`);
}
assert.deepStrictEqual(seen, {
  'Numbers XCDR1': '1,2 and 7', 'Numbers XCDR2': '1,2 and 7',
  'Points XCDR1': '1,2 and 7', 'Points XCDR2': 'RangeError',
  'Pair XCDR1': '1,2 and 7', 'Pair XCDR2': '8,1 and 2',
  'Names XCDR1': 'a,b and 7', 'Names XCDR2': 'RangeError',
});
NODE
node seen.js
