#!/bin/sh
# python-can's CanutilsLogReader takes SocketCAN error frames of a candump file for data frames, but for those of the class bus error.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

# linux/can/error.h: bit 29 of the id marks an error frame, bits 0 to 8 its classes; candump -l -e writes it so.
classes = {0x002: "lost arbitration", 0x004: "controller problem", 0x040: "bus off", 0x080: "bus error", 0x100: "restarted"}
open("a.log", "w").write("".join(f"(1600000000.000000) can0 {1 << 29 | one:08X}#0004000000000000\n" for one in classes))
read = list(can.CanutilsLogReader("a.log"))
for name, message in zip(classes.values(), read, strict=True):
    kind = "an error frame" if message.is_error_frame else f"a data frame of the extended id 0x{message.arbitration_id:X}"
    print(f"python-can {can.__version__}: {name} comes as {kind}, {message.dlc} bytes")
assert [message.is_error_frame for message in read] == [False, False, False, True, False]
assert [message.arbitration_id for message in read] == [0x002, 0x004, 0x040, 0, 0x100]
PYTHON
