#!/bin/sh
# A frame that is 0.1 s older than the first one of its file comes back 50 years later from ASC, and on the first one's time from BLF.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

start = 1600000000.0  # expected of ASCWriter by its documentation: an older frame gets the time of the last message written
back = {}
for name in ("a.asc", "a.blf", "a.trc"):
    with can.Logger(name) as writer:
        for late in (0.5, 0.4, 0.6):  # two buses' frames do not come in the order of their times
            writer.on_message_received(can.Message(timestamp=start + late, arbitration_id=1, is_extended_id=False, data=b"1", channel=0))
    arguments = {"relative_timestamp": False} if name == "a.asc" else {}
    with can.LogReader(name, **arguments) as reader:
        back[name] = [round(message.timestamp - start, 3) for message in reader]
    print(f"python-can {can.__version__}: frames of 0.5, 0.4 and 0.6 s come back from {name} with the times {back[name]} s")
assert back["a.asc"] == [0.5, start + 0.9, 0.6] and back["a.blf"] == [0.5, 0.5, 0.6] and back["a.trc"] == [0.5, 0.4, 0.6]
PYTHON
