#!/bin/sh
# mdfr writes an MF4 file with a structure, such as any recording of CAN frames, so that neither asammdf nor mdfr itself can read it; texts it loses.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mdfr==0.7.3 asammdf==8.8.28 python-can==4.6.1 numpy==2.4.6
cd "$folder"
venv/bin/python - 2> errors <<'PYTHON' || { cat errors >&2; exit 1; }
import logging
from importlib.metadata import version

import asammdf
import can
import mdfr
import numpy as np

logging.disable()
times = np.arange(4) * 0.1
for name, samples in (("numbers", np.arange(4.0)), ("texts", np.array([b"free", b"car", b"wall", b"?"]))):
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(samples, times, name="seen", encoding="utf-8" if name == "texts" else None)])
        file.save(f"{name}.mf4")
with can.MF4Writer("frames.mf4") as writer:
    writer.on_message_received(can.Message(timestamp=1.6e9, arbitration_id=0x100, is_extended_id=False, data=b"\x01", channel=1))


def tried(work):
    try:
        found = work()
        return found if found is None else [one.decode() if isinstance(one, bytes) else one for one in np.asarray(found).tolist()]
    except Exception as error:  # MdfException of asammdf, RuntimeError of mdfr
        return type(error).__name__


def with_mdfr(name, channel):
    file = mdfr.Mdfr(name)
    file.load_all_channels_data_in_memory()
    return file.get_channel_data(channel)


seen = {}
for name, channel in (("numbers", "seen"), ("texts", "seen"), ("frames", "CAN_DataFrame.ID")):
    file = mdfr.Mdfr(f"{name}.mf4")
    file.load_all_channels_data_in_memory()
    file.write(f"{name}_again.mf4", mdfr.CompressionAlgorithm.NoCompression)
    seen[name] = [
        tried(lambda: with_mdfr(f"{name}.mf4", channel)),
        tried(lambda: with_mdfr(f"{name}_again.mf4", channel)),
        tried(lambda: asammdf.MDF(f"{name}_again.mf4").get(channel).samples),
    ]
    first, again, theirs = seen[name]
    print(f"{name}: mdfr {version('mdfr')} reads {first}, and of what it then writes {again}; asammdf {asammdf.__version__} {theirs}")
assert seen == {
    "numbers": [[0.0, 1.0, 2.0, 3.0]] * 3,
    "texts": [["free", "car", "wall", "?"], None, []],
    "frames": [[0x100], "RuntimeError", "MdfException"],
}
PYTHON
