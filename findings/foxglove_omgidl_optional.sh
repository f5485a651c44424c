#!/bin/sh
# @foxglove/omgidl-serialization takes the flag before an optional member in XCDR2 for the member: 7 is read as 1, and 5 behind it as 7.
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
from typing import Optional

from pycdr2 import IdlStruct
from pycdr2.annotations import mutable
from pycdr2.types import float64, int32


@dataclass
class Count(IdlStruct, typename="Count"):
    value: Optional[int32]
    end: int32


@dataclass
class Range(IdlStruct, typename="Range"):
    value: Optional[float64]
    end: int32


@dataclass
@mutable
class Loose(IdlStruct, typename="Loose"):
    value: Optional[int32]
    end: int32


messages = [Count(7, 5), Count(None, 5), Range(1.5, 5), Loose(7, 5), Loose(None, 5)]
made = [(f"{type(message).__name__} {message.value}", message.serialize(use_version_2=True)) for message in messages]
assert all(type(message).deserialize(data) == message for message, (_, data) in zip(messages, made, strict=True))
assert made[0][1].hex() == "00070000" + "01000000" + "07000000" + "05000000"
with open("made.json", "w") as file:
    json.dump({name: data.hex() for name, data in made}, file)
PYTHON
cat > seen.js <<'NODE'
const assert = require('node:assert');
const { readFileSync } = require('node:fs');
const { parseIDL } = require('@foxglove/omgidl-parser');
const { MessageReader } = require('@foxglove/omgidl-serialization');

const definition = parseIDL(`@final struct Count { @optional int32 value; int32 end; };
  @final struct Range { @optional double value; int32 end; }; @mutable struct Loose { @optional int32 value; int32 end; };`);
const seen = {};
for (const [name, hex] of Object.entries(JSON.parse(readFileSync('made.json')))) {
  try {
    const { value, end } = new MessageReader(name.split(' ')[0], definition).readMessage(Buffer.from(hex, 'hex'));
    seen[name] = `${value} and ${end}`;
  } catch (error) {
    seen[name] = `${error.name}: ${error.message}`;
  }
  console.log(`pycdr2 1.0.0 wrote ${name} and 5; @foxglove/omgidl-serialization 1.0.3 reads ${seen[name]}`);
}
assert.strictEqual(seen['Count 7'], '1 and 7');
assert.strictEqual(seen['Count None'], '0 and 5');
assert.strictEqual(seen['Range 1.5'], '5e-324 and 1073217536');
assert.strictEqual(seen['Loose 7'], '7 and 5'); // mutable: each member has a number and a length of its own
assert(seen['Loose None'].startsWith('RangeError'));
NODE
node seen.js
