#!/bin/sh
# mdfr leaves out the first member of each structure in an MF4 file: of python-can's CAN_DataFrame the bus, so that two buses are one.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mdfr==0.7.3 asammdf==8.8.28 python-can==4.6.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import asammdf
import can
import mdfr
import numpy as np


def seen(name, whole):
    """What asammdf and mdfr find under the names of the members of a structure."""
    with asammdf.MDF(name) as file:
        members = [channel.name for channel in file.groups[0].channels if channel.name.startswith(f"{whole}.")]
        ours = {member: file.get(member).samples.tolist() for member in members}
    theirs = mdfr.Mdfr(name)
    theirs.load_all_channels_data_in_memory()
    return ours, {member: list(found) for member in members if (found := theirs.get_channel_data(member)) is not None}


with can.MF4Writer("a.mf4") as writer:
    for number in range(4):
        frame = can.Message(timestamp=1.6e9 + number, arbitration_id=0x100, is_extended_id=False, data=bytes([number]), channel=1 + number % 2)
        writer.on_message_received(frame)
values = np.rec.fromarrays([np.arange(1, 4, dtype="u1"), np.arange(1, 4, dtype="f4")], names=["point.sensor", "point.range"])
with asammdf.MDF(version="4.10") as file:
    file.append([asammdf.Signal(values, np.arange(3) * 0.1, name="point")])
    file.save("b.mf4")
for name, whole, first in (("a.mf4", "CAN_DataFrame", "CAN_DataFrame.BusChannel"), ("b.mf4", "point", "point.sensor")):
    ours, theirs = seen(name, whole)
    lost = {member: found for member, found in ours.items() if member not in theirs}
    print(f"asammdf {asammdf.__version__} finds {len(ours)} members of {whole}, mdfr {version('mdfr')} {len(theirs)}; lost: {lost}")
    assert list(ours)[0] == first and lost == {first: ours[first]}
    assert all(theirs[member] == ours[member] for member in theirs if not member.endswith("DataBytes"))
PYTHON
