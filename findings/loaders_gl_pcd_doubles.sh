#!/bin/sh
# @loaders.gl/pcd reads every point of a PCD file with doubles at 0, 0, 0, and none of a binary one with an intensity of one byte; pypcd4 reads both.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-save --no-audit --no-fund @loaders.gl/core@4.4.2 @loaders.gl/pcd@4.4.2 @math.gl/types@4.1.0
python3 -m venv venv
venv/bin/pip install --quiet pypcd4==1.5.1 numpy==2.4.6
cat > read.mjs <<'NODE'
import { readFileSync } from 'node:fs';
import { parseSync } from '@loaders.gl/core';
import { PCDLoader } from '@loaders.gl/pcd';

const file = readFileSync(process.argv[2]);
try {
  const points = parseSync(file.buffer.slice(file.byteOffset, file.byteOffset + file.length), PCDLoader);
  console.log(JSON.stringify([...points.attributes.POSITION.value]));
} catch (error) {
  console.log(JSON.stringify(error.name));
}
NODE
venv/bin/python - <<'PYTHON'
import json
import subprocess
from importlib.metadata import version

import numpy as np
from pypcd4 import PointCloud

kinds = {
    "floats": {"x": "f4", "y": "f4", "z": "f4", "intensity": "f4"},
    "doubles": {"x": "f8", "y": "f8", "z": "f8", "intensity": "f4"},
    "floats and a byte": {"x": "f4", "y": "f4", "z": "f4", "intensity": "u1"},
}
seen = {}
for name, kind in kinds.items():
    points = np.array([(1, 2, 3, 40), (4, 5, 6, 70)], np.dtype(list(kind.items())))
    head = ["VERSION 0.7", "FIELDS " + " ".join(kind), "SIZE " + " ".join(one[1] for one in kind.values())]
    head += ["TYPE " + " ".join(one[0].upper() for one in kind.values()), "COUNT 1 1 1 1", "WIDTH 2", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0"]
    open("a.pcd", "wb").write("\n".join([*head, "POINTS 2", "DATA binary", ""]).encode() + points.tobytes())
    theirs = json.loads(subprocess.run(["node", "read.mjs", "a.pcd"], check=True, capture_output=True, text=True).stdout)
    ours = PointCloud.from_path("a.pcd").numpy(("x", "y", "z")).ravel().tolist()
    seen[name] = theirs, ours
    print(f"x, y, z of two points, {name}: @loaders.gl/pcd 4.4.2 {theirs}, pypcd4 {version('pypcd4')} {ours}")
there = [1, 2, 3, 4, 5, 6]
assert seen == {"floats": (there, there), "doubles": ([0] * 6, there), "floats and a byte": ("RangeError", there)}
PYTHON
