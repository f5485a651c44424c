#!/bin/sh
# A classic frame of eight bytes whose length code in an ASC file is above 8 is one of 64 bytes in python-can, and stays so in BLF.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

# Classic CAN: the codes 9 to 15 mean eight bytes too. Vector's ASC writes the code as it was on the bus.
head = "date Sun Sep 13 12:26:40.000 pm 2020\nbase hex  timestamps absolute\ninternal events logged\n"
open("a.asc", "w").write(head + "0.010000 1 100 Rx d f 01 02 03 04 05 06 07 08\n")
(frame,) = can.ASCReader("a.asc")
with can.BLFWriter("a.blf") as writer:
    writer.on_message_received(frame)
(again,) = can.BLFReader("a.blf")
seen = [(one.is_fd, one.dlc, len(one.data)) for one in (frame, again)]
print(f"python-can {can.__version__}: (is_fd, dlc, bytes) out of ASC and out of a BLF file written of it: {seen}, expected (False, 8, 8)")
assert seen == [(False, 64, 8), (False, 64, 8)]
PYTHON
