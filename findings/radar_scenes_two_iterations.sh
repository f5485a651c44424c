#!/bin/sh
# Two iterations over one Sequence of radar_scenes share their place: zip of two sensors' scenes gives other sensors' and leaves some out.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet h5py==3.16.0 numpy==2.4.6
"$folder/venv/bin/pip" install --quiet --no-deps radar_scenes==1.0.4
cd "$folder"
venv/bin/python - <<'PYTHON'
import json
from importlib.metadata import version

import h5py
import numpy as np
from radar_scenes.sequence import Sequence

# A sequence as the data set lays it: scenes of the sensors 1 to 4 in turn, 4 rounds, a detection each.
times, sensors = [1000 + 17 * number for number in range(16)], [1 + number % 4 for number in range(16)]


def neighbour(number, step):
    return times[number + step] if 0 <= number + step < len(times) else None


scenes = {
    str(stamp): {
        "sensor_id": sensors[number],
        "prev_timestamp": neighbour(number, -1),
        "next_timestamp": neighbour(number, 1),
        "prev_timestamp_same_sensor": neighbour(number, -4),
        "next_timestamp_same_sensor": neighbour(number, 4),
        "odometry_timestamp": stamp,
        "odometry_index": number,
        "image_name": "",
        "radar_indices": [number, number + 1],
    }
    for number, stamp in enumerate(times)
}
with open("scenes.json", "w") as file:
    json.dump({"sequence_name": "a", "scenes": scenes, "first_timestamp": times[0], "last_timestamp": times[-1]}, file)
with h5py.File("radar_data.h5", "w") as file:
    file["radar_data"] = np.zeros(len(times), [("timestamp", "i8")])
    file["odometry"] = np.zeros(len(times), [("timestamp", "i8")])
sequence = Sequence.from_json("scenes.json")
alone = [scene.timestamp for scene in sequence.scenes(1)]
pairs = [(one.sensor_id, other.sensor_id) for one, other in zip(sequence.scenes(1), sequence.scenes(3), strict=False)]
print(f"radar_scenes {version('radar_scenes')}: sensor 1 alone has {len(alone)} scenes; zip of the sensors 1 and 3 gives pairs of {pairs}")
assert alone == times[::4]
assert pairs == [(1, 3), (3, 3)]  # expected (1, 3) four times
PYTHON
