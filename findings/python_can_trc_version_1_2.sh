#!/bin/sh
# python-can takes a TRC file of version 1.2, which PEAK's description has between 1.1 and 1.3, for one of 1.0, and raises ValueError.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

frames = {  # by the columns of PEAK's TRC file format: number, time in ms, bus (from 1.2 on), direction, id, length, data
    "1.1": " 1) 1059.9 Rx 0300 2 01 02\n",
    "1.2": " 1) 1059.900 1 Rx 0300 2 01 02\n",
    "1.3": " 1) 1059.900 1 Rx 0300 - 2 01 02\n",
}
seen = {}
for version, frame in frames.items():
    open("a.trc", "w").write(f";$FILEVERSION={version}\n;$STARTTIME=44087.5185185185\n{frame}")
    try:
        seen[version] = [f"{message.arbitration_id:X}" for message in can.TRCReader("a.trc")]
    except ValueError as error:
        seen[version] = f"ValueError: {error}"
print(f"python-can {can.__version__}: the frame with the id 300 comes as {seen}")
assert seen["1.1"] == seen["1.3"] == ["300"] and seen["1.2"].startswith("ValueError: invalid literal for int()")
PYTHON
