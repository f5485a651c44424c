#!/bin/sh
# cantools in its strict default loads two thirds of the DBC files that opendbc ships and drives cars by.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cantools==45.0.0
"$folder/venv/bin/pip" install --quiet --no-deps --ignore-requires-python opendbc==0.3.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from collections import Counter
from importlib.metadata import distribution
from pathlib import Path

import cantools

package = distribution("opendbc")
files = sorted(Path(str(package.locate_file(name))) for name in package.files if str(name).endswith(".dbc"))
refused = Counter()
for path in files:
    try:
        cantools.database.load_file(path)
    except Exception as error:
        refused[type(error).__name__] += 1
print(f"cantools {cantools.__version__}, opendbc {package.version}: {len(files) - sum(refused.values())} of {len(files)} load; refused: {dict(refused)}")
assert (len(files), sum(refused.values())) == (94, 31)
PYTHON
