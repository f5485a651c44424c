#!/bin/sh
# On a disk that is full before a picture ends, Pillow's save leaves a torn file and raises nothing; a limit on a file's size stands for the disk.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pillow==12.0.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import random
import resource
from pathlib import Path

import PIL
from PIL import Image

ROOM = 10_000  # bytes
picture = Image.frombytes("L", (180, 180), random.Random(0).randbytes(180 * 180))  # no format makes it much smaller
names = ("a.pgm", "a.bmp", "a.tif", "a.jpg", "a.png")
for name in names:
    picture.save(name)
whole = {name: Path(name).stat().st_size for name in names}
resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM))  # expected beyond it: OSError, "File too large", as of a plain write
silent = []
for name in names:
    torn = Path(name).with_stem("torn")
    try:
        picture.save(torn)
        silent.append(name)
        print(f"Pillow {PIL.__version__}: {torn.stat().st_size} of the {whole[name]} bytes of {name} were written, and save raised nothing")
    except OSError as error:
        print(f"Pillow {PIL.__version__}: {name}: {error}")
try:
    Path("plain").write_bytes(b"x" * whole["a.pgm"])
except OSError as error:
    print(f"the same by a plain write: {error}")
assert silent == ["a.pgm", "a.bmp", "a.tif", "a.jpg"], silent
PYTHON
