#!/bin/sh
# asammdf takes a signal that a DBC file has on several pages (SG_MUL_VAL_) from one page alone, that of its m0.
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
text = """VERSION ""
NS_ :
BS_:
BU_: A
BO_ 301 M: 8 A
 SG_ page M : 0|8@1+ (1,0) [0|0] "" A
 SG_ range m0 : 8|8@1+ (1,0) [0|0] "m" A
 SG_ azimuth m4 : 8|8@1- (1,0) [0|0] "deg" A
SG_MUL_VAL_ 301 range page 0-3, 8-9;
SG_MUL_VAL_ 301 azimuth page 4-7;
"""
open("a.dbc", "w").write(text)
pages = (0, 3, 4, 7, 9)
with can.MF4Writer("a.mf4") as writer:
    for page in pages:
        data = bytes((page, 10 + page, 0, 0, 0, 0, 0, 0))
        writer.on_message_received(can.Message(timestamp=2e9 + page, arbitration_id=301, is_extended_id=False, data=data, channel=0))
with asammdf.MDF("a.mf4") as file, file.extract_bus_logging({"CAN": [("a.dbc", 0)]}) as found:
    seen = {name: found.get(name).samples.tolist() for name in ("range", "azimuth")}
print(
    f"asammdf {asammdf.__version__}: of the pages {pages}, each with the value 10 + page, come {seen}, "
    "expected range 10, 13, 19 and azimuth 14, 17"
)
assert seen == {"range": [10], "azimuth": [14]}
PYTHON
