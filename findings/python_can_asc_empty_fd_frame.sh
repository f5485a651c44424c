#!/bin/sh
# python-can's ASCWriter writes a CAN FD frame without data, and its ASCReader reads it back as a remote frame, which CAN FD does not have.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

with can.ASCWriter("a.asc") as writer:
    for data in (b"", b"1"):
        writer.on_message_received(can.Message(timestamp=1.6e9, arbitration_id=1, is_extended_id=False, is_fd=True, data=data, channel=0))
back = [(message.is_fd, message.is_remote_frame) for message in can.ASCReader("a.asc")]
print(f"python-can {can.__version__}: (is_fd, is_remote_frame) of two data frames come back as {back}, expected (True, False) twice")
assert back == [(True, True), (True, False)]
PYTHON
