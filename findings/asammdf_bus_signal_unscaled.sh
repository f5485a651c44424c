#!/bin/sh
# asammdf's get_bus_signal, by default, leaves the scale of a signal out once its DBC file names one of the values.
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
text = 'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 291 M: 8 A\n SG_ range : 0|16@1+ (0.1,0) [0|0] "m" A\n'
seen = {}
for kind, names in (("none named", ""), ("one named", 'VAL_ 291 range 4095 "none" ;\n')):
    open("a.dbc", "w").write(text + names)
    with can.MF4Writer("a.mf4") as writer:
        data = (100).to_bytes(8, "little")
        writer.on_message_received(can.Message(timestamp=2e9, arbitration_id=291, is_extended_id=False, data=data, channel=0))
    with asammdf.MDF("a.mf4") as file:
        # its documentation: ignore_value2text_conversion, True by default, leaves conversions to text out
        options = {}, {"ignore_value2text_conversion": False}
        seen[kind] = [float(file.get_bus_signal("CAN", "M.range", database="a.dbc", **more).samples[0]) for more in options]
print(f"asammdf {asammdf.__version__}: a range of 10 m, by default and with ignore_value2text_conversion=False: {seen}")
assert seen == {"none named": [10.0, 10.0], "one named": [100.0, 10.0]}
PYTHON
