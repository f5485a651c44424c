"""A recording into a map, as numpy arrays: no service, no network.

python examples/map_of_a_recording.py [DRIVE] [-c CONFIG]     a folder with can.log.gz and echogrid.toml, or a log
"""

import argparse
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.map.tiled_map import FREE, OCCUPIED, probability
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline


def main(drive_or_log: Path, config_path: Path | None = None) -> None:
    drive = find_drive(drive_or_log, config_path)
    config = load_config(drive.config)
    pipeline = Pipeline(config, drive.config)
    way = []  # x, y of the rear axle in odom at each map update
    for update in pipeline.updates(Log(drive.log).batches()):
        way.append((update.ego.odom_from_base.x, update.ego.odom_from_base.y))
    pipeline.mapper.end_cycle()  # the last one, which no further message ends
    if not way:
        raise EchogridError(f"{drive.log}: no map came of it; `echogrid check` says why")
    row, column, log_odds = pipeline.mapper.map.whole()  # (H, W) rows along y, columns along x; 0 where never seen
    cell = config.grid.cell
    x, y = column * cell, row * cell  # m in odom, of the corner of cell [0, 0]
    known = log_odds != 0
    p = np.where(known, probability(log_odds), np.nan)  # of occupied
    print(f"{np.hypot(*np.diff(way, axis=0).T).sum():.0f} m driven, {len(way)} map updates")
    print(f"x from {x:.1f} to {x + p.shape[1] * cell:.1f} m, y from {y:.1f} to {y + p.shape[0] * cell:.1f} m")
    for name, cells in {"free": p <= FREE, "occupied": p >= OCCUPIED, "neither": (p > FREE) & (p < OCCUPIED)}.items():
        print(f"{name}: {cells.sum() * cell**2:.0f} m²")
    np.savez_compressed("recording.npz", probability=p, origin=(x, y), cell=cell, way=way)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("drive", type=Path, nargs="?", default=Path(str(files("echogrid") / "demo_drive")))
    parser.add_argument("-c", "--config", type=Path, help="default: the drive's echogrid.toml")
    given = parser.parse_args()
    try:
        main(given.drive, given.config)
    except (EchogridError, OSError) as error:  # a file that cannot be read or written: a sentence for who typed its name
        sys.exit(str(error))
