#!/bin/sh
# pyquaternion's yaw_pitch_roll are not the angles about z, y' and x'' that it says: of a car heading 120° on a road that rises by 10° the pitch is that of one that falls.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pyquaternion==0.9.9
"$folder/venv/bin/pip" install --quiet numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version
from math import asin, atan2, degrees, radians

from pyquaternion import Quaternion

said = Quaternion.yaw_pitch_roll.__doc__.split("\n")[0]
assert "intrinsic Tait-Bryan angles following the z-y'-x'' convention" in said, said
angles = (120.0, -10.0, 5.0)  # degrees, about z, then the new y, then the new x
about_z, about_y, about_x = (Quaternion(axis=axis, angle=radians(angle)) for axis, angle in zip(((0, 0, 1), (0, 1, 0), (1, 0, 0)), angles))
car = about_z * about_y * about_x  # of rotations about the car's own axes the first stands leftmost
nose = car.rotate([1.0, 0.0, 0.0])
print(f"the car's nose points to {degrees(atan2(nose[1], nose[0])):.3f}° and up by {degrees(asin(nose[2])):.1f}°")
given = [degrees(angle) for angle in car.yaw_pitch_roll]
print(f"pyquaternion {version('pyquaternion')}: {said.strip()}")
print(f"expected {angles}, found {', '.join(f'{angle:.3f}' for angle in given)}")
reverse = [degrees(angle) for angle in (about_x * about_y * about_z).yaw_pitch_roll]
print(f"of the rotations in the opposite order: {', '.join(f'{angle:.3f}' for angle in reverse)}")
assert abs(degrees(atan2(nose[1], nose[0])) - 120.0) < 1e-9
assert [round(angle, 3) for angle in given] == [119.933, 9.321, 6.180], given
assert [round(angle, 6) for angle in reverse] == list(angles), reverse
PYTHON
