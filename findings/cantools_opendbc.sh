#!/bin/sh
# cantools refuses 22 of the 58 DBC files that opendbc ships whole and drives cars by, and 12 of them with strict=False too.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.1.0
"$folder/venv/bin/pip" install --quiet --no-deps --ignore-requires-python opendbc==0.3.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import distribution
from pathlib import Path

import cantools

package = distribution("opendbc")
names = [str(name) for name in package.files if str(name).endswith(".dbc") and str(name).count("/") == 2]
files = [Path(str(package.locate_file(name))) for name in sorted(names) if name.startswith("opendbc/dbc/")]


def refused(strict):
    count = 0
    for path in files:
        try:
            cantools.database.load_file(path, strict=strict)
        except cantools.database.UnsupportedDatabaseFormatError:
            count += 1
    return count


found = len(files), refused(True), refused(False)
print(f"cantools {cantools.__version__}, opendbc {package.version}: of {found[0]} files {found[1]} are refused, {found[2]} of them with strict=False too")
assert found == (58, 22, 12)
PYTHON
