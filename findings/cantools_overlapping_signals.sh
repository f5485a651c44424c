#!/bin/sh
# cantools loads messages with overlapping signals with strict=False, and then decodes none of their frames: 193 messages of the opendbc files.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
"$folder/venv/bin/pip" install --quiet --no-deps --ignore-requires-python opendbc==0.3.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import distribution

import cantools


def decoded(message):
    try:
        return message.decode(bytes(range(message.length)), decode_choices=False)
    except cantools.database.DecodeError as error:
        return f"DecodeError: {error}"


# A 16-bit counter of which another signal is the low byte. Its documentation: overlapping signals raise an error where strict is True.
text = 'VERSION ""\nNS_ :\nBS_:\nBU_: A\nBO_ 291 M: 8 A\n SG_ whole : 0|16@1+ (1,0) [0|0] "" A\n SG_ low : 0|8@1+ (1,0) [0|0] "" A\n'
seen = decoded(cantools.database.load_string(text, "dbc", strict=False).messages[0])
package = distribution("opendbc")
names = [str(name) for name in package.files if str(name).startswith("opendbc/dbc/") and str(name).endswith(".dbc") and str(name).count("/") == 2]
found = {}
for name in names:
    try:
        found[name] = [decoded(message) for message in cantools.database.load_file(str(package.locate_file(name)), strict=False).messages]
    except cantools.database.UnsupportedDatabaseFormatError:
        pass
refused = {name: sum(one == "DecodeError: unpacking failed" for one in messages) for name, messages in found.items()}
print(f"cantools {cantools.__version__}: bytes 0, 1, 2, ... of the message: {seen}")
counts = sum(map(len, found.values())), sum(refused.values()), sum(map(bool, refused.values()))
print(f"opendbc {package.version}: {counts[0]} messages are loaded, {counts[1]} of them, in {counts[2]} files, not decoded")
assert seen == "DecodeError: unpacking failed"
assert counts == (3183, 193, 10)
PYTHON
