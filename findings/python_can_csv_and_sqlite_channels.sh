#!/bin/sh
# python-can's CSV and SQLite recordings keep no channel: two buses in one file cannot be told apart any more.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

sent = [can.Message(timestamp=1.6e9 + n, arbitration_id=0x100, is_extended_id=False, data=b"1", channel=n % 2) for n in range(4)]
found = {}
for name in ("a.csv", "a.db", "a.blf"):
    with can.Logger(name) as writer:
        for message in sent:
            writer.on_message_received(message)
    with can.LogReader(name) as reader:
        found[name] = [message.channel for message in reader]
    print(f"python-can {can.__version__}: channels 0, 1, 0, 1 come back from {name} as {found[name]}")
assert found == {"a.csv": [None] * 4, "a.db": [None] * 4, "a.blf": [0, 1, 0, 1]}
PYTHON
