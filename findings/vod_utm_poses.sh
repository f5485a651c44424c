#!/bin/sh
# vod-tudelft, the devkit of the View-of-Delft radar data set, reads the car's place in UTM as float32: it stands, and then jumps by half a meter.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet vod-tudelft==1.0.3 numpy==2.4.6 matplotlib==3.11.2 k3d==3.2.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
from vod.configuration import KittiLocations
from vod.frame import FrameDataLoader, FrameTransformMatrix, homogeneous_transformation

# The data set's pose files, a matrix a line, of a car in Delft (zone 31U) that drives north at 2 m/s, ten frames a second.
folder = Path("lidar/training/pose")
folder.mkdir(parents=True)
north = 5762000.0 + 0.2 * np.arange(6)
found = []
for number, value in enumerate(north):
    pose = np.eye(4)
    pose[:2, 3] = 593000.0, value
    lines = [json.dumps({name: pose.ravel().tolist()}) for name in ("odomToCamera", "mapToCamera", "UTMToCamera")]
    (folder / f"{number:05}.json").write_text("\n".join(lines) + "\n")
    transforms = FrameTransformMatrix(FrameDataLoader(KittiLocations("."), f"{number:05}"))
    found.append(float(homogeneous_transformation(np.array([[0.0, 0.0, 0.0, 1.0]]), transforms.t_utm_camera)[0, 1]))
steps = np.diff(found).tolist()
print(f"vod-tudelft {version('vod-tudelft')}: the car goes {np.diff(north).round(3).tolist()} m a frame, its points {steps} m")
assert transforms.t_utm_camera.dtype == np.float32 and set(steps) == {0.0, 0.5}
PYTHON
