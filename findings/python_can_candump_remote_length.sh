#!/bin/sh
# A remote frame that asks for 5 bytes, written by python-can as a candump file, comes back as one that asks for none; its reader knows the length.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

asked = can.Message(timestamp=1600000000.0, arbitration_id=0x123, is_extended_id=False, is_remote_frame=True, dlc=5, channel="can0")
back = {}
for name in ("a.log", "a.asc", "a.blf"):
    with can.Logger(name) as logger:
        logger(asked)
    back[name] = [(message.is_remote_frame, message.dlc) for message in can.LogReader(name)]
line = open("a.log").read().strip()
with open("b.log", "w") as file:  # as can-utils' candump -l writes it
    file.write("(1600000000.000000) can0 123#R5\n")
back["b.log, by candump"] = [(message.is_remote_frame, message.dlc) for message in can.LogReader("b.log")]
print(f"python-can {can.__version__} writes {line!r}; read back (remote, length): {back}")
assert line == "(1600000000.000000) can0 123#R R"
assert back == {"a.log": [(True, 0)], "a.asc": [(True, 5)], "a.blf": [(True, 5)], "b.log, by candump": [(True, 5)]}
PYTHON
