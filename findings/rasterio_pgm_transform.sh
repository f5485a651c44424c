#!/bin/sh
# rasterio gives a map's PGM file a transform of arbitrary numbers, where it says that it is the identity, and is for PNG.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rasterio==1.4.4
"$folder/venv/bin/pip" install --quiet pillow==13.0.0
"$folder/venv/bin/pip" install --quiet numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import warnings

import numpy as np
import rasterio
from PIL import Image

# The images that map_server writes and reads beside its YAML file are PGM or PNG. Neither says where the map lies.
cells = np.array([[0, 205, 254], [254, 254, 0]], np.uint8)
seen = {}
for name in ("map.png", "map.pgm"):
    Image.fromarray(cells).save(name)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        with rasterio.open(name) as file:
            read = np.array_equal(file.read(1), cells)
            seen[name] = read, file.transform.is_identity, any("identity matrix will be returned" in f"{one.message}" for one in said)
print(
    f"rasterio {rasterio.__version__}, GDAL {rasterio.__gdal_version__}: cells as written, transform is the identity, warning that it is: {seen}"
)
assert seen == {"map.png": (True, True, True), "map.pgm": (True, False, True)}
PYTHON
