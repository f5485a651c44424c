#!/bin/sh
# python-can's ASCReader reads "timestamps relative" in the head of a Vector ASC file, and gives the steps from line to line as times.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import can

text = "date Sun Sep 13 12:26:40.000 pm 2020\nbase hex  timestamps relative\ninternal events logged\n"
text += "0.000000 1 100 Rx d 1 00\n" + "0.010000 1 100 Rx d 1 00\n" * 3
open("a.asc", "w").write(text)
reader = can.ASCReader("a.asc")
times = [message.timestamp for message in reader]
print(f"python-can {can.__version__}: head says {reader.timestamps_format}, frames every 10 ms have the times {times}, expected 0, 0.01, 0.02, 0.03")
assert reader.timestamps_format == "relative" and times == [0.0, 0.01, 0.01, 0.01]
PYTHON
