#!/bin/sh
# A frame that python-can's TRCWriter writes for channel 0 comes back on channel 1, and one for 'can1' on channel 2.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

back = []
for channel in (0, 3, "can1"):
    with can.TRCWriter("a.trc") as writer:
        writer.on_message_received(can.Message(timestamp=1600000000.0, arbitration_id=0x123, is_extended_id=False, data=b"\x01", channel=channel))
    back += [message.channel for message in can.TRCReader("a.trc")]
print(f"python-can {can.__version__}: written for the channels 0, 3 and 'can1', read back from TRC as {back}")
assert back == [1, 4, 2]
PYTHON
