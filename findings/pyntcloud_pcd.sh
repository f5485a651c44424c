#!/bin/sh
# pyntcloud, which takes any numpy, reads no binary PCD file with one of today, and no ASCII one with a signed byte or a single point.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyntcloud==0.3.1 numpy==2.4.6
"$folder/venv/bin/pip" install --quiet pypcd4==1.5.1
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import requires, version

import numpy as np
from pyntcloud import PyntCloud
from pypcd4 import PointCloud


def file(kinds, count, how, data):
    head = ["VERSION 0.7", "FIELDS x y z flag", "SIZE 4 4 4 " + kinds[1], "TYPE F F F " + kinds[0], "COUNT 1 1 1 1"]
    head += [f"WIDTH {count}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {count}", f"DATA {how}", ""]
    return "\n".join(head).encode() + data


cases = {
    "ascii": file("F4", 2, "ascii", b"1 2 3 0\n4 5 6 1\n"),
    "binary": file("F4", 2, "binary", np.array([[1, 2, 3, 0], [4, 5, 6, 1]], np.float32).tobytes()),
    "ascii, signed byte": file("I1", 2, "ascii", b"1 2 3 0\n4 5 6 -1\n"),
    "ascii, one point": file("F4", 1, "ascii", b"1 2 3 0\n"),
}
seen = {}
for name, data in cases.items():
    open("a.pcd", "wb").write(data)
    try:
        seen[name] = PyntCloud.from_file("a.pcd").points["x"].tolist()
    except (ValueError, KeyError, TypeError) as error:
        seen[name] = f"{type(error).__name__}: {error}"
    print(f"pyntcloud {version('pyntcloud')}, numpy {np.__version__}, {name}: x {seen[name]}, pypcd4 {PointCloud.from_path('a.pcd').pc_data['x'].tolist()}")
print(f"pyntcloud asks for {[one for one in requires('pyntcloud') if one.startswith('numpy')]}")
assert seen["ascii"] == [1.0, 4.0] and [said.split(":")[0] for said in list(seen.values())[1:]] == ["ValueError", "KeyError", "TypeError"]
PYTHON
