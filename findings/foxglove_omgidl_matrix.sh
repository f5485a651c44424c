#!/bin/sh
# @foxglove/omgidl-serialization writes a matrix, double m[2][3], as its own reader gives it, as two values that are not a number: no reader takes the bytes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-save --no-audit --no-fund @foxglove/omgidl-parser@1.1.0 @foxglove/omgidl-serialization@1.0.3
cat > seen.js <<'NODE'
const assert = require('node:assert');
const { parseIDL } = require('@foxglove/omgidl-parser');
const { MessageReader, MessageWriter } = require('@foxglove/omgidl-serialization');

const definition = parseIDL('struct Odometry { double covariance[2][3]; };');
const writer = new MessageWriter('Odometry', definition, {});
const reader = new MessageReader('Odometry', definition);
const plain = (message) => message.covariance.map((row) => Array.from(row));

// CDR lays the six numbers one behind the other: so they are read, and so the writer takes them as one flat list.
const right = Buffer.concat([Buffer.from([0, 1, 0, 0]), Buffer.from(new Float64Array([1, 2, 3, 4, 5, 6]).buffer)]);
const message = reader.readMessage(right);
const flat = Buffer.from(writer.writeMessage({ covariance: [1, 2, 3, 4, 5, 6] }));
const written = Buffer.from(writer.writeMessage(message));
const numbers = [written.readDoubleLE(4), written.readDoubleLE(12)];
let again;
try {
  again = plain(reader.readMessage(written));
} catch (error) {
  again = `${error.name}: ${error.message}`;
}
console.log(`@foxglove/omgidl-serialization 1.0.3 reads ${JSON.stringify(plain(message))} of ${right.length} bytes; the flat list becomes ${flat.length} bytes,`);
console.log(`the message that was read ${written.length} bytes with ${numbers}; read again: ${again}`);
assert.deepStrictEqual(plain(message), [[1, 2, 3], [4, 5, 6]]);
assert.deepStrictEqual([...flat], [...right]);
assert(written.length === 20 && numbers.every(Number.isNaN) && again.startsWith('RangeError'));
NODE
node seen.js
