#!/bin/sh
# python-can's MF4Writer takes the moment of writing for the start: a recording converted to MF4 has negative times in asammdf.
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
recorded = 1600000000.0
with can.MF4Writer("a.mf4") as writer:
    for step in range(3):
        writer.on_message_received(
            can.Message(timestamp=recorded + step, arbitration_id=0x123, is_extended_id=False, data=b"\x01", channel=0)
        )
with asammdf.MDF("a.mf4") as file:
    start = file.header.start_time.timestamp()
    first = float(file.get_master(0)[0])
print(
    f"python-can {can.__version__}, asammdf {asammdf.__version__}: frames of 2020 written now have a file that starts {start - recorded:.0f} s "
    f"after the first of them, whose time in it is {first:.0f} s"
)
assert start - recorded > 1e8 and first < -1e8
PYTHON
