#!/bin/sh
# A bus on channel 0, written as MF4 by python-can and exported from there to ASC by asammdf, is on channel -1 in python-can.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "python-can[mf4]==4.6.1" asammdf==8.8.28
cd "$folder"
venv/bin/python - <<'PYTHON'
import logging
import warnings

import asammdf
import can

logging.disable(logging.CRITICAL)
warnings.simplefilter("ignore")
with can.MF4Writer("a.mf4") as writer:
    for channel in (0, 1):
        writer.on_message_received(can.Message(timestamp=2e9 + channel, arbitration_id=1, is_extended_id=False, data=b"1", channel=channel))
with asammdf.MDF("a.mf4") as file:
    file.export("asc", "a.asc", overwrite=True)
back = {name: [message.channel for message in can.LogReader(name)] for name in ("a.mf4", "a.asc")}
with can.Logger("b.asc") as writer:
    for message in can.LogReader("a.mf4"):
        writer.on_message_received(message)
back["b.asc"] = [message.channel for message in can.LogReader("b.asc")]
print(
    f"python-can {can.__version__}, asammdf {asammdf.__version__}: the channels 0 and 1 are {back['a.mf4']} in MF4, {back['a.asc']} in the ASC file "
    f"that asammdf makes of it, {back['b.asc']} in that of python-can"
)
assert back == {"a.mf4": [0, 1], "a.asc": [-1, 0], "b.asc": [0, 1]}
PYTHON
