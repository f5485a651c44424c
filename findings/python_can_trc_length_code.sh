#!/bin/sh
# python-can's TRCReader puts the length code of a CAN FD frame into Message.dlc, where its other readers put bytes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

head = ";$FILEVERSION=2.1\n;$STARTTIME=44087.5185185185\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
open("a.trc", "w").write(head + "      1     0.000 FB 1 0300 Rx -  15   " + " ".join(["00"] * 64) + "\n")
(frame,) = can.TRCReader("a.trc")
print(f"python-can {can.__version__}: dlc {frame.dlc} with {len(frame.data)} bytes of data, expected 64")
assert (frame.dlc, len(frame.data)) == (15, 64)
PYTHON
