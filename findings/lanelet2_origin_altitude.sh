#!/bin/sh
# lanelet2's Origin takes the longitude that it is given by name for the altitude too, and drops the altitude: the map is 8.4 m or 91.6 m off.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet lanelet2==1.2.3
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

from lanelet2.core import GPSPoint
from lanelet2.io import Origin
from lanelet2.projection import LocalCartesianProjector

# A point at the origin itself, 100 m above the ellipsoid: at 0, 0, 0 where the origin has that altitude, and 100 m up where it has none.
origins = {
    "Origin(49, 8.4, 100)": Origin(49, 8.4, 100),
    "Origin(lat=49, lon=8.4, alt=100)": Origin(lat=49, lon=8.4, alt=100),
    "Origin(49, 8.4)": Origin(49, 8.4),
    "Origin(lat=49, lon=8.4)": Origin(lat=49, lon=8.4),
}
seen = {}
for said, origin in origins.items():
    seen[said] = origin.position.alt, round(LocalCartesianProjector(origin).forward(GPSPoint(49, 8.4, 100)).z, 3)
    print(f"lanelet2 {version('lanelet2')}, {said}: altitude {seen[said][0]} m, a point at 100 m has z = {seen[said][1]} m")
assert list(seen.values()) == [(100.0, 0.0), (8.4, 91.6), (0.0, 100.0), (8.4, 91.6)]
print(signature := next(line for line in Origin.__init__.__doc__.splitlines() if "lat" in line).strip())
assert signature.count("lon") == 2 and "alt" not in signature
PYTHON
