#!/bin/sh
# OpenCV scales a PGM whose maximum is not 255 if its numbers are text, and not if they are bytes: one map of 100 shades is two pictures.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet opencv-python-headless==5.0.0.93
"$folder/venv/bin/pip" install --quiet pillow==13.0.0
cd "$folder"
venv/bin/python - <<'PYTHON'
from pathlib import Path

import cv2
import numpy as np
import PIL
from PIL import Image

# pgm(5): each pixel is a share of the maximum, "a gray value is a number from 0 through Maxval"; with 100 a white pixel is 100.
Path("text.pgm").write_text("P2\n3 1\n100\n0 50 100\n")
Path("bytes.pgm").write_bytes(b"P5\n3 1\n100\n" + bytes((0, 50, 100)))
Path("words.pgm").write_bytes(b"P5\n3 1\n1000\n" + np.array((0, 500, 1000), ">u2").tobytes())
found, others = {}, {}
for name in ("text.pgm", "bytes.pgm", "words.pgm"):
    found[name] = cv2.imread(name, cv2.IMREAD_GRAYSCALE).ravel().tolist()
    with Image.open(name) as picture:
        pixels = np.asarray(picture).ravel()
    others[name] = (pixels / (65535 if pixels.max() > 255 else 255)).round(2).tolist()
    print(f"{name}: black, grey, white: OpenCV {cv2.__version__} {found[name]}, Pillow {PIL.__version__} {others[name]} of white")
assert all(shares == [0.0, 0.5, 1.0] for shares in others.values()), others
assert found == {"text.pgm": [0, 127, 255], "bytes.pgm": [0, 50, 100], "words.pgm": [0, 1, 3]}, found
PYTHON
