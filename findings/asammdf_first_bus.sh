#!/bin/sh
# asammdf cannot decode channel 0 of an MF4 file, python-can's first bus, alone: 0 is every bus, and other buses' frames are read by its DBC file.
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
for name, factor in (("front", 1), ("rear", 10)):  # two buses with the same id
    open(f"{name}.dbc", "w").write(f'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 256 M: 8 A\n SG_ {name} : 0|8@1+ ({factor},0) [0|0] "m" A\n')
with can.MF4Writer("a.mf4") as writer:
    for step, channel in enumerate((0, 1, 0, 1)):
        writer.on_message_received(
            can.Message(timestamp=2e9 + step, arbitration_id=256, is_extended_id=False, data=bytes([step + 1]), channel=channel)
        )
seen = {}
with asammdf.MDF("a.mf4") as file, file.extract_bus_logging({"CAN": [("front.dbc", 0), ("rear.dbc", 1)]}) as found:
    for number, group in enumerate(found.groups):
        for place, channel in enumerate(group.channels):
            if channel.name != "time":
                seen.setdefault(channel.name, []).append(found.get(channel.name, number, place).samples.tolist())
print(f"asammdf {asammdf.__version__}: 1 and 3 m of the first bus, 20 and 40 m of the second are {seen}")
assert seen == {"front": [[1, 3], [2, 4]], "rear": [[20, 40]]}
PYTHON
