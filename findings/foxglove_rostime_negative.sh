#!/bin/sh
# @foxglove/rostime makes of -0.5 s a duration with negative nanoseconds, which a ROS 2 message written by @foxglove/rosmsg2-serialization has as +3.8 s.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-save --no-audit --no-fund @foxglove/rostime@1.1.3 @foxglove/rosmsg@5.0.5 @foxglove/rosmsg2-serialization@3.1.0
cat > seen.js <<'NODE'
const assert = require('node:assert');
const { parse } = require('@foxglove/rosmsg');
const { MessageReader, MessageWriter } = require('@foxglove/rosmsg2-serialization');
const { fromMillis, fromNanoSec, fromSec, subtract } = require('@foxglove/rostime');

// builtin_interfaces/Duration: int32 sec, uint32 nanosec. -0.5 s is -1 s and 500000000 ns.
const definition = parse('builtin_interfaces/Duration age\n', { ros2: true });
const durations = {
  'subtract 1 s - 1.5 s': subtract({ sec: 1, nsec: 0 }, { sec: 1, nsec: 500000000 }),
  'fromSec(-0.5)': fromSec(-0.5),
  'fromMillis(-500)': fromMillis(-500),
  'fromNanoSec(-500000000n)': fromNanoSec(-500000000n),
};
const seen = [];
for (const [name, { sec, nsec }] of Object.entries(durations)) {
  const data = new MessageWriter(definition).writeMessage({ age: { sec, nanosec: nsec } });
  const { age } = new MessageReader(definition).readMessage(data);
  seen.push([sec, nsec, age.sec + age.nanosec / 1e9]);
  console.log(`@foxglove/rostime 1.1.3, ${name}: ${sec} s ${nsec} ns; written and read again: ${age.sec + age.nanosec / 1e9} s`);
}
const wrong = [0, -500000000, 3.794967296];
assert.deepStrictEqual(seen.map((row) => row.map((one) => one + 0)), [[-1, 500000000, -0.5], wrong, wrong, wrong]);
NODE
node seen.js
