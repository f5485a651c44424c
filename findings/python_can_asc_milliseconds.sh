#!/bin/sh
# python-can's ASCWriter writes the milliseconds of a date without leading zeros, so that its own reader is off by up to 0.9 s.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

with can.ASCWriter("a.asc") as writer:
    writer.on_message_received(can.Message(timestamp=1600000000.007, arbitration_id=1, data=b"1", channel=0))
(frame,) = can.ASCReader("a.asc", relative_timestamp=False)
print(f"python-can {can.__version__}: written at .007 s, read back at {frame.timestamp % 1:.3f} s")
assert abs(frame.timestamp % 1 - 0.7) < 1e-3
PYTHON
