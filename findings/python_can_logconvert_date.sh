#!/bin/sh
# python-can's converter drops the date of an ASC file: frames of 2020 are of 1970 in what it writes.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import subprocess
import sys
from datetime import UTC, datetime

import can

head = "date Sun Sep 13 12:26:40.000 pm 2020\nbase hex  timestamps absolute\ninternal events logged\n"
open("a.asc", "w").write(head + "0.010000 1 100 Rx d 1 07\n1.010000 1 100 Rx d 1 07\n")
for name in ("b.log", "b.trc", "b.asc"):
    subprocess.run([sys.executable, "-m", "can.logconvert", "a.asc", name], check=True)
years = {}
for name in ("a.asc", "b.log", "b.trc", "b.asc"):
    arguments = {"relative_timestamp": False} if name.endswith(".asc") else {}
    with can.LogReader(name, **arguments) as reader:
        years[name] = datetime.fromtimestamp(next(iter(reader)).timestamp, UTC).year
print(f"python-can {can.__version__}: the year in which the first frame came: {years}")
assert years == {"a.asc": 2020, "b.log": 1970, "b.trc": 1970, "b.asc": 1970}
PYTHON
