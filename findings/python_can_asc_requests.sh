#!/bin/sh
# python-can's ASCReader takes a request to send (TxRq) of Vector's ASC for a frame: what a tester sends is there twice.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

# Vector's ASC format: the direction is Rx, Tx, or TxRq, which is logged when a frame is handed to the controller, before its Tx.
lines = "0.010000 1 100 TxRq d 1 07\n0.010240 1 100 Tx d 1 07\n0.020000 1 101 Rx d 1 00\n"
open("a.asc", "w").write("date Sun Sep 13 12:26:40.000 pm 2020\nbase hex  timestamps absolute\ninternal events logged\n" + lines)
back = [(f"{message.arbitration_id:X}", message.timestamp, message.is_rx) for message in can.ASCReader("a.asc")]
print(f"python-can {can.__version__}: one frame sent and one received come as {back}")
assert back == [("100", 0.01, False), ("100", 0.01024, False), ("101", 0.02, True)]
PYTHON
