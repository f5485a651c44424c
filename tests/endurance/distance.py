"""A hundred kilometres round a street that closes: memory, the time of an update, room on the disk, and whether the map stays the same."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.map.tiled_map import LogOdds, probability
from echogrid.core.messages import RadarScan, Speed
from echogrid.live.service import resident_mib
from echogrid.pipeline import Pipeline
from tests.endurance.chart import Curve, chart
from tests.endurance.street import ClosedStreet

BEGIN_NS = 1_700_000_000_000_000_000
MIB = 24  # of tiles in memory: less than a tenth of a lap's
SAMPLE_M = 500.0
UPDATES = 512  # of which the time is the median: of the mapping thread alone, whatever else the machine does
PLACES = 24  # along the lap where the map is compared
CELLS = 256  # of the window that is compared, and of that which is read out as if to publish it
WORTH = 0.1  # of p: a cell that differs by more is another one


def distance(drive: Path, out: Path, kilometres: float, model: str | None = None) -> dict[str, Any]:
    """Writes distance.json, distance.svg and map.egmap into `out`; returns the summary. The radars are those of a drive folder."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "map.egmap"
    for old in out.glob("map.egmap*"):
        old.unlink()
    source = drive / "echogrid.toml"
    config = load_config(source, model)
    config = msgspec.structs.replace(config, map=msgspec.structs.replace(config.map, max_mib=MIB))
    pipeline = Pipeline(config, source)
    mapper, lock, stop = pipeline.mapper, threading.Lock(), threading.Event()
    street = ClosedStreet(mapper.mounts)
    samples: list[dict[str, float]] = []
    laps: list[list[LogOdds]] = []  # the windows at PLACES after the first, the second and the last lap
    times: deque[float] = deque(maxlen=UPDATES)
    started = time.monotonic()
    with pipeline.keep(path, BEGIN_NS, lock) as keeper:
        flusher = threading.Thread(target=keeper.run, args=(stop,))
        flusher.start()
        try:
            for lap in range(round(kilometres * 1e3 / street.lap_m)):
                for item in street.lap(lap, BEGIN_NS):
                    if isinstance(item, RadarScan):
                        mapper.on_scan(item)
                        continue
                    mapper.on_motion(item)
                    if not isinstance(item, Speed):
                        continue
                    with lock:
                        before = time.thread_time()
                        update = mapper.update(item.stamp_ns)
                        if update is None:
                            continue
                        mapper.map.around(update.ego.odom_from_base, CELLS)
                        times.append(time.thread_time() - before)
                    if mapper.odometry.distance >= SAMPLE_M * (len(samples) + 1):
                        samples.append(
                            {
                                "wall_s": time.monotonic() - started,
                                "driven_km": mapper.odometry.distance / 1e3,
                                "update_ms": float(np.median(times)) * 1e3,
                                "slow_ms": float(np.percentile(times, 99)) * 1e3,
                                "rss_mib": resident_mib(),
                                "tiles": len(mapper.map.tiles),
                                "disk_mib": sum(file.stat().st_size for file in out.glob("map.egmap*")) / 2**20,
                                "lost_tiles": keeper.status.forgotten + mapper.map.forgotten,
                            }
                        )
                with lock:
                    laps[2:] = [_places(street, pipeline)]  # besides the first two, the last
        finally:
            stop.set()
            flusher.join()
    summary = summarise(samples, laps, street, mapper.map.max_tiles)
    (out / "distance.json").write_text(json.dumps({"summary": summary, "samples": samples}, indent=1) + "\n")
    (out / "distance.svg").write_text(draw(samples))
    return summary


def summarise(samples: list[dict[str, float]], laps: list[list[LogOdds]], street: ClosedStreet, most_tiles: int) -> dict[str, Any]:
    """`laps`: the windows at PLACES after the first, the second and the last lap."""
    tenth = max(len(samples) // 10, 1)
    begin, end = (float(np.median([s["update_ms"] for s in part])) for part in (samples[tenth : 2 * tenth], samples[-tenth:]))
    lap = round(street.lap_m / SAMPLE_M)
    return {
        "driven_km": samples[-1]["driven_km"],
        "lap_km": street.lap_m / 1e3,
        "wall_min": samples[-1]["wall_s"] / 60,
        "most_tiles": most_tiles,
        "tiles": max(sample["tiles"] for sample in samples),
        "rss_mib": [min(s["rss_mib"] for s in samples[tenth:]), max(s["rss_mib"] for s in samples[tenth:])],
        "update_ms_second_and_last_tenth": [begin, end],
        "update_ratio": end / begin,
        "disk_kib_per_km_of_new_street_with_log": samples[lap - 1]["disk_mib"] * 1024 / samples[lap - 1]["driven_km"],
        "disk_mib": samples[-1]["disk_mib"],
        "lost_tiles": samples[-1]["lost_tiles"],
        "second_lap_against_first": compare(laps[0], laps[1]),
        "last_lap_against_second": compare(laps[1], laps[-1]),
    }


def compare(before: list[LogOdds], after: list[LogOdds]) -> dict[str, float]:
    """Of the cells known before: the share that is unknown after, that differs in p by more than WORTH, and the mean difference of p."""
    one, other = np.stack(before), np.stack(after)
    known = one != 0
    change = np.abs(probability(one) - probability(other))[known]
    return {"gone": float((other[known] == 0).mean()), "changed": float((change > WORTH).mean()), "mean_change_of_p": float(change.mean())}


def draw(samples: list[dict[str, float]]) -> str:
    """SVG."""
    curves = (
        Curve("resident memory, MiB", [sample["rss_mib"] for sample in samples]),
        Curve("tiles in memory", [sample["tiles"] for sample in samples]),
        Curve("one update and the window around the car, ms of its thread, median of 512", [sample["update_ms"] for sample in samples]),
        Curve("the same, 99th percentile", [sample["slow_ms"] for sample in samples]),
        Curve("file and its write-ahead log, MiB", [sample["disk_mib"] for sample in samples]),
    )
    return chart([sample["driven_km"] for sample in samples], "km driven", curves)


def _places(street: ClosedStreet, pipeline: Pipeline) -> list[LogOdds]:
    poses = [street.states[index].odom_from_base for index in np.linspace(0, len(street.states) - 1, PLACES).astype(int)]
    return [pipeline.mapper.map.around(pose, CELLS)[2].copy() for pose in poses]
