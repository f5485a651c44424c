#!/bin/sh
# python-can's CanutilsLogReader raises ValueError at the raw length code that can-utils writes behind eight bytes (candump -8, Linux 5.11 on).
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

open("a.log", "w").write("(1600000000.000000) can0 123#1122334455667788_B\n")
try:
    seen = str(next(iter(can.CanutilsLogReader("a.log"))))
except ValueError as error:
    seen = f"ValueError: {error}"
print(f"python-can {can.__version__}: eight bytes with the raw length code B give {seen}")
assert seen.startswith("ValueError")
PYTHON
