#!/bin/sh
# python-can's SizedRotatingLogger writes over the newest frames of the drive before: the last file keeps the plain name.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import time
from pathlib import Path

import can


def drive(start):
    with can.SizedRotatingLogger("drive.log", max_bytes=200) as logger:
        for number in range(12):
            logger.on_message_received(can.Message(timestamp=start + number, arbitration_id=number, is_extended_id=False, data=bytes(8), channel=0))


def kept(start):
    found = [message.timestamp - start for name in Path().glob("drive*.log") for message in can.LogReader(name)]
    return sorted(round(late) for late in found if 0 <= late < 100)


# its documentation: a new file is made where the size is reached; what is left when the logger stops is in drive.log
drive(1.6e9)
before = kept(1.6e9)
time.sleep(1.5)  # the full files are called after the second in which they were closed
drive(1.7e9)
after = kept(1.6e9)
print(f"python-can {can.__version__}: of the first drive's 12 frames there are {len(before)}, and {len(after)} after the second: {after}")
assert before == list(range(12)) and after == list(range(10))
PYTHON
