#!/bin/sh
# asammdf gives a named value of a signal as NaN where other values have no name, and as text where all have one.
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
    'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 291 M: 8 A\n SG_ range : 0|16@1+ (0.1,0) [0|0] "m" A\nVAL_ 291 range 0 "touching" 4095 "none" ;\n'
)


def extracted(raws):
    with can.MF4Writer("a.mf4") as writer:
        for step, raw in enumerate(raws):
            data = raw.to_bytes(8, "little")
            writer.on_message_received(can.Message(timestamp=2e9 + step, arbitration_id=291, is_extended_id=False, data=data, channel=0))
    with asammdf.MDF("a.mf4") as file, file.extract_bus_logging({"CAN": [("a.dbc", 0)]}) as found:
        return found.get("range").samples


mixed, named = extracted((0, 5, 4095)), extracted((0, 4095))
print(f"asammdf {asammdf.__version__}: touching, 0.5 m, none: {mixed.tolist()}; touching, none: {named.tolist()}")
assert str(mixed.tolist()) == "[nan, 0.5, nan]" and named.tolist() == [b"touching", b"none"]
PYTHON
