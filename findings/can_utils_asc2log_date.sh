#!/bin/sh
# can-utils' asc2log gives the frames of an ASC file the present time where the machine has no English locale: its date is read by that alone.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet python-can==4.6.1
cd "$folder"
apt-get -o APT::Sandbox::User=root download -qq can-utils=2020.11.0-1
dpkg --extract can-utils_*.deb .
printf '%s\n' 'date Sun Sep 13 12:26:40.000 pm 2020' 'base hex  timestamps absolute' 'no internal events logged' \
    '   0.010000 1  100             Rx   d 2 07 00' > a.asc
apt-get -o APT::Sandbox::User=root download -qq locales=2.36-9+deb12u14
dpkg --extract locales_*.deb .
mkdir none english
I18NPATH="$folder/usr/share/i18n" localedef -i en_US -f ISO-8859-1 english/en_US
for name in none english; do
    LOCPATH="$folder/$name" TZ=UTC usr/bin/asc2log -I a.asc -O $name.log 2>> said
done
TZ=UTC venv/bin/python - <<'PYTHON'
from datetime import UTC, datetime

import can

with can.ASCReader("a.asc", relative_timestamp=False) as reader:
    years = [datetime.fromtimestamp(message.timestamp, UTC).year for message in reader]
for name in ("english.log", "none.log"):
    years += [datetime.fromtimestamp(message.timestamp, UTC).year for message in can.LogReader(name)]
said = open("said").read().strip().splitlines()
print(f"a frame of 2020: python-can {can.__version__} {years[0]}; can-utils 2020.11.0 with a locale en_US {years[1]}, with none {years[2]}: {said}")
assert years == [2020, 2020, datetime.now(UTC).year] and years[2] > 2020
PYTHON
