"""What a map update costs with more radars, more detections, longer cycles and a larger map: `python -m tests.bench.scaling OUT.svg`."""

from __future__ import annotations

import itertools
import json
import math
import statistics
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.health import Health, SensorHealth
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.tile import Tile
from echogrid.core.mapper import Mapper
from echogrid.core.messages import RadarScan, Speed, YawRate
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise, static_range_rate
from echogrid.model.choice import choose
from tests.endurance.chart import Curve, chart

SPEED = 8.0  # m/s
MOTION_NS, SCAN_NS = 10_000_000, 50_000_000
WARM, UPDATES = 20, 40
RADARS, DETECTIONS, CYCLES_MS, TILES = (1, 2, 3, 4, 6, 8), (2, 16, 64, 128, 256, 512), (25, 50, 100, 200), (0, 64, 256, 1024)


def mounts(count: int) -> dict[str, Mount]:
    """Around the car, all looking outwards."""
    found = {}
    for n in range(count):
        angle = 2 * math.pi * (n + 0.5) / count
        place = SE2(1.4 + 2.2 * math.cos(angle), 0.8 * math.sin(angle), angle)
        found[f"r{n}"] = Mount(place, math.radians(75), 25.0)
    return found


def cost_ms(radars: int = 4, detections: int = 64, cycle_ms: int = 50, tiles: int = 0) -> float:
    """Median ms of processor time of an update, network included, its scans and motion too: of a straight drive, each radar's scan with
    so many detections of things that stand. `tiles` that the map has in memory besides."""
    around, spec, rng = mounts(radars), GridSpec(), np.random.default_rng(0)
    choice = choose("default", spec, around)
    occupancy = LookMap(spec, choice.model.contract.calibration)
    occupancy.tiles |= {(1000 + n, 0): Tile.empty(LookMap.layers) for n in range(tiles)}
    health = Health(sensors={name: SensorHealth() for name in around})
    mapper = Mapper(around, choice.model, occupancy, health, GateNoise(), cycle_ms * 1_000_000, 200_000_000)
    spent, took = list[float](), 0.0
    for now_ns in itertools.count(MOTION_NS, MOTION_NS):
        scans = []
        if now_ns % SCAN_NS == 0:
            for name, mount in around.items():
                azimuth = rng.uniform(-1.2, 1.2, detections)
                rate, _ = static_range_rate(azimuth, mount, SPEED, 0.0)
                scans.append(RadarScan(name, now_ns, now_ns, rng.uniform(2, 40, detections), azimuth, rate, rng.normal(0, 5, detections)))
        begun = time.thread_time()
        mapper.on_motion(Speed(now_ns, SPEED))
        mapper.on_motion(YawRate(now_ns, 0.0))
        for scan in scans:
            mapper.on_scan(scan)
        update = mapper.update(now_ns)
        took += time.thread_time() - begun
        if update is not None:
            spent.append(took)
            took = 0.0
            if len(spent) == WARM + UPDATES:
                return statistics.median(spent[WARM:]) * 1e3
    raise AssertionError


def scaling() -> dict[str, dict[int, float]]:
    """Each of them alone, the others as in the demo drive."""
    return {
        "radars": {count: cost_ms(radars=count) for count in RADARS},
        "detections of a radar in a cycle, four radars": {count: cost_ms(detections=count) for count in DETECTIONS},
        "cycle time, ms": {ms: cost_ms(cycle_ms=ms) for ms in CYCLES_MS},
        "tiles of the map in memory": {count: cost_ms(tiles=count) for count in TILES},
    }


def draw(found: dict[str, dict[int, float]]) -> str:
    """SVG."""
    return chart((), "", [Curve(f"ms of an update, against {what}", [*row.values()], over=[*row]) for what, row in found.items()])


def main(arguments: Iterable[str]) -> None:
    """Prints the figures and draws them."""
    found = scaling()
    print(json.dumps(found, indent=1))
    for out in arguments:
        Path(out).write_text(draw(found) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
