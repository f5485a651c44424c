#!/bin/sh
# asammdf reads a signed signal of eight bits that does not start with a byte as unsigned: -5 m/s are 251.
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
text = 'VERSION ""\nNS_ :\nBS_:\nBU_: A\n'
widths, starts = (7, 8, 9), range(16)
with can.MF4Writer("a.mf4") as writer:
    for width in widths:
        for start in starts:
            identifier = 100 * width + start
            text += f'BO_ {identifier} M{identifier}: 8 A\n SG_ s{identifier} : {start}|{width}@1- (1,0) [0|0] "m/s" A\n'
            data = ((-5 & (1 << width) - 1) << start).to_bytes(8, "little")
            writer.on_message_received(
                can.Message(timestamp=2e9 + identifier, arbitration_id=identifier, is_extended_id=False, data=data, channel=0)
            )
open("a.dbc", "w").write(text)
with asammdf.MDF("a.mf4") as file, file.extract_bus_logging({"CAN": [("a.dbc", 0)]}) as found:
    seen = {width: [found.get(f"s{100 * width + start}").samples.tolist()[0] for start in starts] for width in widths}
for width in widths:
    print(f"asammdf {asammdf.__version__}: -5 m/s in {width} bits, from the bit 0, 1, ... 15: {seen[width]}")
assert seen == {7: [-5] * 16, 8: ([-5] + [251] * 7) * 2, 9: [-5] * 16}
PYTHON
