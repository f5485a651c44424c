#!/bin/sh
# A CAN FD frame of 64 bytes comes back from python-can's CSV and SQLite recordings as a classic frame of 64 bytes, of which BLF keeps 8.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

sent = can.Message(
    timestamp=1600000000.0, arbitration_id=0x300, is_extended_id=False, is_fd=True, bitrate_switch=True, is_rx=False, data=bytes(range(64))
)
seen = {}
for name, writer, reader in (("a.csv", can.CSVWriter, can.CSVReader), ("a.db", can.SqliteWriter, can.SqliteReader), ("a.blf", can.BLFWriter, can.BLFReader)):
    with writer(name) as file:
        file.on_message_received(sent)
    (back,) = reader(name)
    with can.BLFWriter("again.blf") as file:
        file.on_message_received(back)
    (again,) = can.BLFReader("again.blf")
    seen[name] = (back.is_fd, back.bitrate_switch, back.is_rx, len(back.data), len(again.data))
print(f"python-can {can.__version__}: FD, bit rate switch, received, bytes, and bytes once it is written into a BLF file: {seen}")
assert seen == {"a.csv": (False, False, True, 64, 8), "a.db": (False, False, True, 64, 8), "a.blf": (True, True, False, 64, 64)}
PYTHON
