#!/bin/sh
# BLF recordings that python-can writes of times that are no dates each start at 0: two of one clock no longer fit.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

back = {}
for name, start in (("front.blf", 5.0), ("rear.blf", 7.5), ("rear.log", 7.5)):  # s on one clock, say since the interface was opened
    with can.Logger(name) as writer:
        for step in range(2):
            writer.on_message_received(can.Message(timestamp=start + step, arbitration_id=1, is_extended_id=False, data=b"1", channel=0))
    with can.LogReader(name) as reader:
        back[name] = [message.timestamp for message in reader]
    print(f"python-can {can.__version__}: frames at {start} and {start + 1} s come back from {name} at {back[name]} s")
assert back == {"front.blf": [0.0, 1.0], "rear.blf": [0.0, 1.0], "rear.log": [7.5, 8.5]}
PYTHON
