#!/bin/sh
# pynmea2 gives a sentence without a fix the position 0, 0: a car in a tunnel is in the Gulf of Guinea. pynmeagps gives none.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pynmea2==1.19.0
"$folder/venv/bin/pip" install --quiet pynmeagps==1.1.8
cd "$folder"
venv/bin/python - <<'PYTHON'
import functools
from importlib.metadata import version

import pynmea2
from pynmeagps import NMEAReader

# NMEA 0183: fields that the receiver does not know are empty, the status V is no fix.
bodies = {
    "fix": "GNRMC,122640.00,A,4807.03800,N,01131.00000,E,0.5,84.4,130920,,,A",
    "no fix": "GNRMC,122641.00,V,,,,,,,130920,,,N",
    "no fix, GGA": "GNGGA,122641.00,,,,,0,00,99.99,,,,,,",
}
seen = {}
for name, body in bodies.items():
    sentence = f"${body}*{functools.reduce(lambda sum, letter: sum ^ ord(letter), body, 0):02X}"
    ours, theirs = pynmea2.parse(sentence, check=True), NMEAReader.parse(sentence + "\r\n")
    seen[name] = (round(ours.latitude, 4), round(ours.longitude, 4)), (theirs.lat, theirs.lon)
    print(f"{name}: latitude and longitude by pynmea2 {version('pynmea2')} {seen[name][0]}, by pynmeagps {version('pynmeagps')} {seen[name][1]}")
assert seen["fix"][0] == (48.1173, 11.5167)
assert all(seen[name] == ((0.0, 0.0), ("", "")) for name in ("no fix", "no fix, GGA"))
PYTHON
