#!/bin/sh
# capkit reads no ASC file whose date is in the English form with am or pm; where it is installed, dbckit cannot read such a file any more either.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet dbckit==1.1.1 python-can==4.6.1
cd "$folder"
cat > seen.py <<'PYTHON'
import sys
from importlib.metadata import version

import can
import dbckit

date = "date Sun Sep 13 02:26:40.000 pm 2020"
with open("a.asc", "w") as file:
    file.write(f"{date}\nbase hex  timestamps absolute\nno internal events logged\n   0.010000 1  123             Rx   d 2 57 01\n")
database = dbckit.parse('VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A\n\nBO_ 291 Radar: 2 A\n SG_ Range : 0|16@1+ (0.1,0) [0|0] "m" A\n')


def tried(work):
    try:
        return work()
    except ValueError as error:
        return f"ValueError: {error}"


seen = {
    f"python-can {can.__version__}": [message.arbitration_id for message in can.ASCReader("a.asc")],
    f"dbckit {version('dbckit')}": tried(lambda: [frame.arbitration_id for frame in dbckit.decode_log(database, "a.asc")]),
}
raised = f"ValueError: Unsupported Vector ASC date header: {date!r}."
if sys.argv[1:] == ["capkit"]:
    import capkit

    seen[f"capkit {version('capkit')}"] = tried(lambda: [frame.arbitration_id for frame in capkit.read("a.asc")])
    assert list(seen.values()) == [[291], raised, raised]
else:
    assert list(seen.values()) == [[291], [291]]
print("; ".join(f"{name}: {found}" for name, found in seen.items()))
PYTHON
venv/bin/python seen.py
venv/bin/pip install --quiet capkit==0.3.0
venv/bin/python seen.py capkit
