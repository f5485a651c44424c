#!/bin/sh
# Buses with names without a number, can_front and can_rear, are one channel in what python-can writes as ASC, BLF and TRC.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

back = {}
for name in ("a.asc", "a.blf", "a.trc", "a.log"):
    with can.Logger(name) as writer:
        for channel in ("can_front", "can_rear"):  # what SocketCAN calls them, python-can has in Message.channel
            writer.on_message_received(can.Message(timestamp=1.6e9, arbitration_id=1, is_extended_id=False, data=b"1", channel=channel))
    with can.LogReader(name) as reader:
        back[name] = [message.channel for message in reader]
    print(f"python-can {can.__version__}: one frame each of can_front and can_rear comes back from {name} on {back[name]}")
assert back == {"a.asc": [0, 0], "a.blf": [0, 0], "a.trc": [1, 1], "a.log": ["can_front", "can_rear"]}
PYTHON
