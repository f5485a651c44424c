#!/bin/sh
# scapy's rdcandump cannot read the candump file that python-can writes: it knows no direction at a line's end.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet scapy==2.8.0
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can
import scapy
from scapy.layers.can import rdcandump

with can.CanutilsLogWriter("a.log") as writer:
    writer.on_message_received(can.Message(timestamp=1600000000.0, arbitration_id=0x123, is_extended_id=False, data=b"\x01", channel=0))
line = open("a.log").read().strip()
try:
    seen = str(rdcandump("a.log"))
except ValueError as error:
    seen = f"ValueError: {error}"
print(f"scapy {scapy.__version__}, python-can {can.__version__}: {line!r} gives {seen}")
assert line.endswith(" R") and seen.startswith("ValueError")
open("b.log", "w").write(line.removesuffix(" R") + "\n")
assert rdcandump("b.log")[0].identifier == 0x123
PYTHON
