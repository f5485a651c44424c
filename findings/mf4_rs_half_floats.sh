#!/bin/sh
# mf4-rs gives each value of a half precision channel of an MF4 file as not a number; asammdf and mdfr give the values.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet mf4-rs==3.7.0 mdfr==0.7.3 asammdf==8.8.28 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
from importlib.metadata import version

import asammdf
import mdfr
import mf4_rs
import numpy as np

values = [0.5, -1.5, 100.0]
with asammdf.MDF(version="4.10") as file:
    for kind in ("f2", "f4", "f8"):
        file.append([asammdf.Signal(np.array(values, kind), np.arange(3) * 0.1, name=kind)])
    file.save("a.mf4")
readers = {"asammdf": asammdf.MDF("a.mf4"), "mdfr": mdfr.Mdfr("a.mf4"), "mf4-rs": mf4_rs.Mdf("a.mf4")}
readers["mdfr"].load_all_channels_data_in_memory()
found = {
    "asammdf": lambda kind: readers["asammdf"].get(kind).samples,
    "mdfr": lambda kind: readers["mdfr"].get_channel_data(kind),
    "mf4-rs": lambda kind: readers["mf4-rs"].values(kind, None),
}
for kind in ("f2", "f4", "f8"):
    seen = {name: np.asarray(reader(kind), float).tolist() for name, reader in found.items()}
    print(f"{8 * int(kind[1])} bits: " + ", ".join(f"{name} {version(name)} {got}" for name, got in seen.items()))
    assert seen["asammdf"] == seen["mdfr"] == values
    assert np.isnan(seen["mf4-rs"]).all() if kind == "f2" else seen["mf4-rs"] == values
PYTHON
