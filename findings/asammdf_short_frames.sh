#!/bin/sh
# asammdf gives a signal that a short frame does not hold as 0, and says nowhere that it was not there.
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
open("a.dbc", "w").write(
    'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 291 M: 8 A\n SG_ count : 0|8@1+ (1,0) [0|0] "" A\n SG_ range : 48|16@1+ (0.01,0) [0|0] "m" A\n'
)
with can.MF4Writer("a.mf4") as writer:
    for step, data in enumerate((bytes((7, 0, 0, 0, 0, 0, 0xC4, 0x09)), bytes((8, 0, 0, 0)))):
        writer.on_message_received(can.Message(timestamp=2e9 + step, arbitration_id=291, is_extended_id=False, data=data, channel=0))
with asammdf.MDF("a.mf4") as file, file.extract_bus_logging({"CAN": [("a.dbc", 0)]}) as found:
    signal = found.get("range", ignore_invalidation_bits=True)
print(
    f"asammdf {asammdf.__version__}: frames of 8 bytes and of 4 give the range {signal.samples.tolist()} m, "
    f"bits of invalid values: {signal.invalidation_bits}"
)
assert signal.samples.tolist() == [25.0, 0.0] and signal.invalidation_bits is None
PYTHON
