"""`make bench`: the figures of docs/performance.md, in one run, beside named references. Prints them and writes out/bench.json.

Absolute times swing by a third on a shared machine; the ratios within one run are what counts.
"""

from __future__ import annotations

import io
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cantools
import numpy as np
from rosbags.typesys import Stores, get_typestore

from echogrid.can import dbc_file
from echogrid.can.dbc import Dbc
from echogrid.can.decode import BatchDecoder, stack
from echogrid.can.intake.frames import FrameBatch
from echogrid.can.profile import find, load_radar
from echogrid.can.radar import RadarReader
from echogrid.can.signals import SignalReader
from echogrid.commands.measuring.floors import floors
from echogrid.commands.measuring.loops import paces, seen
from echogrid.commands.measuring.stages import stages
from echogrid.config.loading import load_config
from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.history_raster import HistoryRaster
from echogrid.core.evidence.raster import Image
from echogrid.core.health import Health, SensorHealth
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tiled_map import View
from echogrid.core.mapper import in_view
from echogrid.core.messages import RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.model.choice import SHIPPED, shipped
from echogrid.model.network import OnnxSensorModel
from echogrid.pipeline import Pipeline
from echogrid.store import tile_data
from echogrid.topics.announcer import Announcer, Snapshots, occupancy_percent
from echogrid.topics.grids import Grid, encode_grid
from echogrid_training.drives import campaign
from echogrid_training.drives.samples import samples
from tests.bench.elfes import elfes
from tests.bench.reading import reading
from tests.bench.scaling import draw, scaling
from tests.support.frames import frame, radar_cycle
from tests.support.places import ROOT

DEMO = ROOT / "service" / "echogrid" / "demo_drive"
ANALYTIC = "rasterise and analytic model"
EVERY = 40  # updates that a map takes, of which one is looked at closely


def median_us(work: Callable[[], Any], repeats: int = 200) -> float:
    """Median processor time of one call in microseconds, after ten calls to warm up: what else the machine does costs no time."""
    for _ in range(10):
        work()
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        work()
        times.append(time.thread_time() - start)
    return statistics.median(times) * 1e6


def decoding() -> dict[str, float]:
    """One cycle of 64 frames of Ford's MRR (10 signals each) by three decoders, and one of our CAN FD radar (64 detections, 8 pages)."""
    import opendbc
    from opendbc.can import CANParser

    ford = Path(opendbc.__file__).parent / "dbc" / "FORD_CADS.dbc"
    dbc = cantools.database.load_file(ford, strict=False)
    random = np.random.default_rng(0)
    messages = [dbc.get_message_by_name(f"MRR_Detection_{n:03d}") for n in range(1, 65)]
    payloads = [random.integers(0, 256, 8, dtype=np.uint8).tobytes() for _ in messages]
    ours = BatchDecoder(dbc_file.parse(ford.read_bytes()).named(messages[0].name)[0])
    pairs = list(zip(messages, payloads, strict=True))
    parser = CANParser("FORD_CADS", [(message.name, 0) for message in messages], 0)
    frames = [(message.frame_id, payload, 0) for message, payload in pairs]
    stamps = iter(range(1, 10**9))
    detections = [(2.0 + 0.3 * i, -1.2 + 0.03 * i, -5.0) for i in range(64)]
    path = find("corner_radar", Path())
    fd = cantools.database.load_file(path.parent / str(load_radar(path).dbc), strict=False)
    config = load_config(DEMO / "echogrid.toml", "analytic")
    reader = SignalReader(config, DEMO / "echogrid.toml", Health())
    cycles = [
        [one for offset in (0, 0x10, 0x20, 0x30) for one in radar_cycle(detections, number, 1.0 + number * 0.05, offset=offset)]
        for number in range(220)
    ]
    batches = iter([FrameBatch.of(cycle) for cycle in cycles])
    buses = np.zeros(len(cycles[0]), np.int64)
    fd_cycle = [(fd.get_message_by_frame_id(message.arbitration_id & 0x30F), bytes(message.data)) for message in cycles[0]]
    scans = [item for _, found in reader.pieces(next(batches), buses) for _, item in found]
    assert [len(scan.range) for scan in scans if isinstance(scan, RadarScan)] == [64] * 4
    ford_path = find("ford_mrr", Path())
    mrr = RadarReader("mrr", load_radar(ford_path), Dbc(ford, ford_path), 0, SensorHealth())
    mrr_frames = [frame(message.frame_id, payload, 1.0) for message, payload in pairs]
    return {
        "ours, batch": median_us(lambda: ours.decode(stack(payloads, 8))),
        "cantools": median_us(lambda: [message.decode(payload, decode_choices=False) for message, payload in pairs]),
        "opendbc parser": median_us(lambda: parser.update([(next(stamps) * 50_000_000, frames)])),
        "ours, frames taken in one by one": median_us(lambda: [mrr.add(message, 1) for message in mrr_frames]),
        "ours, four FD radars' cycle to scans (36 frames, 256 detections, CRC)": median_us(
            lambda: list(reader.pieces(next(batches), buses))
        ),
        "cantools, decoding those 36 frames alone": median_us(lambda: [m.decode(data, decode_choices=False) for m, data in fd_cycle]),
    }


def models() -> dict[str, float]:
    """Microseconds of what an update asks of each model and each map: medians over updates of the demo drive, by turns in one run.

    Of the updates that the default map takes, with the history that it then has.
    """
    drive = find_drive(DEMO, None)
    config = load_config(drive.config, "analytic")
    pipeline = Pipeline(config, drive.config)
    spec, mounts, infer = config.grid.spec(), pipeline.mapper.mounts, pipeline.mapper.infer
    raster, total, looks = HistoryRaster(spec, mounts), OccupancyMap(spec), LookMap(spec, Calibration())
    view = View(0, np.bitwise_or.reduce(list(in_view(mounts, spec).values())))
    networks = [OnnxSensorModel(path, spec, mounts) for name in SHIPPED for path in shipped(name) if path.exists()]
    times: dict[str, list[float]] = {}
    seen: list[tuple[Surroundings, Image]] = []

    def noted(around: Surroundings) -> Image:
        start = time.perf_counter()
        said = infer(around)
        times.setdefault(ANALYTIC, []).append((time.perf_counter() - start) * 1e6)
        seen.append((around, said))
        return np.stack((said, said))

    def compare(around: Surroundings, said: Image, pose: SE2) -> None:
        works = {
            "rasterise the last 15 m": partial(raster, around),
            **{f"network {model.path.stem}": partial(model.answer, model.draw(around)) for model in networks},
            "integrate, sum": partial(total.integrate, said, pose, view),
            "integrate, looks": partial(looks.integrate, np.stack((said, said)), pose, view),
            "window to publish, sum": partial(total.around, pose, config.publish.window_cells),
            "window to publish, looks": partial(looks.around, pose, config.publish.window_cells),
        }
        for name, work in works.items():
            times.setdefault(name, []).append(median_us(work, repeats=5))

    pipeline.mapper.infer, pipeline.mapper.map = noted, LookMap(spec, Calibration())
    for update in pipeline.updates(Log(drive.log).batches()):
        if len(seen) >= EVERY:
            compare(*seen[-1], update.ego.odom_from_base)
            seen.clear()
    return {name: statistics.median(spent) for name, spent in times.items()}


def keeping() -> dict[str, float]:
    """Microseconds for one tile and one window of the demo drive's map after 20 s, ours beside what else would do it; medians."""
    drive = find_drive(DEMO, None)
    config = load_config(drive.config, "default")
    pipeline = Pipeline(config, drive.config)
    update = next(update for update in pipeline.updates(Log(drive.log).batches()) if pipeline.health.cycles >= 400)
    tile = max(pipeline.mapper.map.tiles.values(), key=lambda tile: int((tile.seen_s > 0).sum()))
    packer = tile_data.Packer()
    packed, layers = packer.pack(tile), len(tile.layers)
    arrays = {"layers": tile.layers, "seen_s": tile.seen_s, "radars": tile.radars}
    zipped = io.BytesIO()
    np.savez_compressed(zipped, **arrays)
    window = pipeline.mapper.map.around(update.ego.odom_from_base, config.publish.window_cells)
    percent = occupancy_percent(window[2])
    grid = Grid(update.ego.stamp_ns, "odom", config.grid.cell, (0.0, 0.0), percent)
    store = get_typestore(Stores.ROS2_JAZZY)
    other = store.deserialize_cdr(encode_grid(grid), "nav_msgs/msg/OccupancyGrid")
    snapshots = Snapshots()
    snapshot = snapshots.take(pipeline.mapper, update, config.publish)
    assert snapshot is not None
    announcer = Announcer(config, "")
    return {
        "tile to bytes, ours": median_us(lambda: packer.pack(tile)),
        "tile to bytes, numpy.savez_compressed": median_us(lambda: np.savez_compressed(io.BytesIO(), **arrays), repeats=50),
        "bytes to tile, ours": median_us(lambda: tile_data.unpacked(packed, layers)),
        "bytes to tile, numpy.load": median_us(lambda: dict(np.load(io.BytesIO(zipped.getvalue()))), repeats=50),
        "size in KiB, ours": len(packed) / 1024,
        "size in KiB, numpy.savez_compressed": len(zipped.getvalue()) / 1024,
        "grid to CDR, ours": median_us(lambda: encode_grid(grid)),
        "grid to CDR, rosbags": median_us(lambda: store.serialize_cdr(other, "nav_msgs/msg/OccupancyGrid")),
        "all messages of a map": median_us(lambda: list(announcer.map(snapshot))),
    }


def simulating() -> dict[str, float]:
    """A drive of the train family from nothing to samples, on one core: simulated, written as CAN frames, and read back by the service."""
    seconds, spent = 20.0, {}
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        campaign.run(campaign.Campaign("train", 1, seconds, seed=1), Path(folder), 1, lambda _: None)
        spent["simulate and write"] = time.perf_counter() - start
        start = time.perf_counter()
        found = sum(1 for _ in samples(Path(folder) / "train-00000", spacing=0.0))
        spent["samples, one a map update"] = time.perf_counter() - start
    total = sum(spent.values())
    return {
        "seconds of work per simulated second": spent["simulate and write"] / seconds,
        "samples per second and core": found / total,
        "minutes for 20,000 samples on 2 cores": 20_000 / (found / total) / 2 / 60,
    }


def main() -> None:
    """All tables."""
    if sys.version_info >= (3, 13):
        sys.exit("make bench: opendbc, beside which decoding is measured, refuses Python 3.13; expected a .venv of Python 3.11 or 3.12")
    decoders, costs, kept, best = decoding(), models(), keeping(), floors()
    drive = find_drive(DEMO, None)
    loops = paces(seen(drive))
    parts = {model: stages(drive, model, 60.0) for model in ("default", "analytic")}
    simulation, beside = simulating(), elfes()
    alone = subprocess.run([sys.executable, "-m", "tests.bench.live", "30"], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    running: dict[str, float] = json.loads(alone.stdout)  # of a process that holds nothing else
    rates, grows = reading(drive.log), scaling()
    reference = decoders["ours, batch"]
    print("decoding one 64-frame cycle")
    for name, value in decoders.items():
        print(f"  {name:<56}{value:9.1f} us{value / reference:8.1f} x")
    print("loops, on what the demo drive gives them")
    for name, pace in loops.items():
        print(f"  {name:<56}{pace.compiled_us:9.1f} us{pace.numpy_us:9.1f} us in numpy{pace.ratio:8.2f} x")
    for model, found in parts.items():
        print(f"one map update of the demo drive with its frames, {model}")
        for name, value in found.per_update_ms.items():
            print(f"  {name:<56}{value * 1e3:9.1f} us")
        print(f"  {'whole cycle':<56}{found.cycle_ms * 1e3:9.1f} us")
        if found.inference_ms is not None:
            print(f"  {'whole cycle against an inference':<56}{found.cycle_ms / found.inference_ms:9.2f} x")
            print(f"  {'the same, nobody taking its messages':<56}{found.unheard_ms / found.inference_ms:9.2f} x")
    print(f"the analytic update beside others, {beside.pop('detections')} detections")
    for name, row in beside.items():
        print(f"  {name:<56}{row['us']:9.1f} us, quartiles {row['quartiles_us']}, ours against it{row['ours_against_it']:8.2f} x")
    print("models and maps, one update")
    analytic = costs[ANALYTIC]
    for name, value in costs.items():
        print(f"  {name:<56}{value:9.1f} us{value / analytic:8.2f} x")
    print("one tile, one window")
    for name, value in kept.items():
        print(f"  {name:<56}{value:9.1f}" + ("" if "KiB" in name else " us"))
    print("the running service, 30 s in real time")
    for name, value in running.items():
        print(f"  {name:<56}{value:9.3f}")
    print("simulating")
    for name, value in simulation.items():
        print(f"  {name:<56}{value:9.2f}")
    print("reading recordings, ours and python-can")
    for name, (ours, theirs) in rates.items():
        print(f"  {name:<10}{ours:9.0f}{theirs:9.0f} thousand frames/s of processor time{ours / theirs:8.1f} x")
    for what, row in grows.items():
        print(f"ms of an update, against {what}: " + ", ".join(f"{at} {value:.2f}" for at, value in row.items()))
    out = ROOT / "out"
    out.mkdir(exist_ok=True)
    (out / "cost.svg").write_text(draw(grows) + "\n")
    (out / "bench.json").write_text(
        json.dumps(
            {
                "decode_us": decoders,
                "kernels_us": {name: pace._asdict() for name, pace in loops.items()},
                "floors": best,
                "live": running,
                "update_ms": {model: found.per_update_ms for model, found in parts.items()},
                "analytic": beside,
                "models_us": costs,
                "keep": kept,
                "simulate": simulation,
                "read": rates,
                "grows": grows,
            },
            indent=2,
        )
        + "\n"
    )


if __name__ == "__main__":
    main()
