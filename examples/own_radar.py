"""A profile for a radar of your own, tried before there is a car: what its DBC encodes is read back in metres, radians and our signs.

python examples/own_radar.py     with owl/owl.dbc, owl/owl.toml (the profile) and owl/echogrid.toml beside it: put yours in their place
"""

import argparse
import sys
from pathlib import Path

import can
import cantools
import numpy as np

from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.core.health import Health
from echogrid.errors import EchogridError

OWL = Path(__file__).parent / "owl"
# Three things: ahead to the left and coming closer, to the right and going away, straight ahead and standing.
RANGE = np.array([5.0, 12.5, 20.0])  # m
AZIMUTH = np.radians([30.0, -10.0, 0.0])  # to the left
RANGE_RATE = np.array([-3.0, 2.5, 0.0])  # m/s, receding


def frames() -> list[can.Message]:
    """The cycle as the radar would send it: here its units and signs are written down a second time, out of its manual."""
    owl = cantools.database.load_file(OWL / "owl.dbc")
    things = [*zip(RANGE, -np.degrees(AZIMUTH), -RANGE_RATE, strict=True), (0.0, 0.0, 0.0)]  # the last page has room for one more
    contents: list[tuple[str, dict[str, float]]] = [("OwlHeader", {"Cycle": 7, "Count": 3})]
    for page in range(2):
        signals = {f"{name}_{k}": things[2 * page + k - 1][i] for k in (1, 2) for i, name in enumerate(("Dist", "Angle", "Closing"))}
        contents.append(("OwlDetections", {"Page": page} | signals))
    out = []
    for name, signals in contents:
        number, data = owl.get_message_by_name(name).frame_id, owl.encode_message(name, signals)
        out.append(can.Message(timestamp=1.0, arbitration_id=number, data=data, is_extended_id=False, is_fd=True))
    return out


def main() -> None:
    source = OWL / "echogrid.toml"
    reader = SignalReader(load_config(source), source, Health())
    scans = [item for message in frames() for item in reader.add("can0", message)]
    if len(scans) != 1:
        sys.exit(f"{len(scans)} scans came of the cycle, expected one: does the profile say how it begins and ends?")
    for name, meant in {"range": RANGE, "azimuth": AZIMUTH, "range_rate": RANGE_RATE}.items():
        read = getattr(scans[0], name)
        print(f"{name}: meant {np.round(meant, 2)}, read {np.round(read, 2)}")
        if len(read) != len(meant) or not np.allclose(read, meant, atol=0.01):
            sys.exit(f"{name}: are its unit and sign right in the profile?")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()  # there is nothing to be given
    try:
        main()
    except EchogridError as error:  # names the file and the key that are wrong in it
        sys.exit(str(error))
