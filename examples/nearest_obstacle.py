"""How far is the nearest obstacle ahead? Subscribes to the map and says so once for each, until nothing comes any more.

python examples/nearest_obstacle.py [ENDPOINT]     beside `echogrid replay DRIVE --publish`, or a service in a car
"""

import argparse
import sys
from contextlib import suppress

import numpy as np

from echogrid.client import Client, Pose, Window, vehicles
from echogrid.errors import EchogridError

OCCUPIED = 50  # percent, from which a cell is called so
HALF_WIDTH = 1.0  # m to both sides of the car's middle
BUMPER = 3.9  # m from the rear axle to the front end: measure your car


def ahead(grid: Window, pose: Pose) -> float | None:
    """m from the bumper to the nearest occupied cell in the way of a car that goes straight on; None where there is none."""
    rows, columns = np.nonzero(grid.occupancy >= OCCUPIED)  # along y, along x
    x = grid.origin[0] + (columns + 0.5) * grid.cell - pose.x  # m, of the cells' centres from the car, along odom's axes
    y = grid.origin[1] + (rows + 0.5) * grid.cell - pose.y
    forward = np.cos(pose.yaw) * x + np.sin(pose.yaw) * y  # the same along the car's axes
    left = np.cos(pose.yaw) * y - np.sin(pose.yaw) * x
    in_the_way = forward[(np.abs(left) <= HALF_WIDTH) & (forward >= BUMPER)]
    return float(in_the_way.min()) - BUMPER if len(in_the_way) else None


def main(endpoint: str) -> None:
    names = vehicles(endpoint, timeout=20.0)
    if not names:
        sys.exit(f"{endpoint}: no vehicle within 20 s; is a service running there?")
    with Client(endpoint, names[0]) as client:
        while (grid := client.grid(timeout=5.0)) is not None:
            pose = client.odometry(timeout=1.0)
            if pose is None:
                continue
            distance = ahead(grid, pose)
            print(f"{pose.stamp_ns * 1e-9:.2f} s, {pose.speed:4.1f} m/s:", "free" if distance is None else f"{distance:.1f} m", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("endpoint", nargs="?", default="tcp/127.0.0.1:7447", help="where the service listens")
    with suppress(KeyboardInterrupt):  # Ctrl-C ends it
        try:
            main(parser.parse_args().endpoint)
        except EchogridError as error:  # is a sentence for who typed the endpoint
            sys.exit(str(error))
