"""`echogrid demo`: the shipped drive over a CAN bus, through the service, over Zenoh, to a subscriber in another process."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from echogrid.client import Client, Window
from echogrid.commands.recorder import Recorder, report
from echogrid.commands.terminal import part, progress, show_map
from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.evidence.raster import rasterize
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tiled_map import LogOdds
from echogrid.errors import EchogridError
from echogrid.files import check_folder
from echogrid.live.player import Player, on_virtual_buses
from echogrid.live.service import Service
from echogrid.logs.drive import Drive, TrueMap, find_drive, load_truth
from echogrid.logs.log import Log
from echogrid.maps.picture import Panel, draw, save, side_by_side
from echogrid.pipeline import Pipeline

PATIENCE = 20.0  # s
# The subscriber. Ctrl-C in a terminal reaches it too, and ends it without a word while it is loading as well.
WATCH = "import signal; signal.signal(signal.SIGINT, signal.SIG_DFL); from echogrid.commands.demo import watch; watch()"
DRIVEN = 0.75  # of the whole: what comes after is the picture beside the others


def command(out: Path, model: str | None, *, as_json: bool) -> None:
    """A progress bar, then the map where a terminal shows it, and the summary in words, or as JSON alone. The rest is as in `demo`."""
    check_folder(out)
    with progress("the demo drive, through the service") as advance:
        summary = demo(out, model, advance)
    if as_json:
        report(summary, out, as_json=True)
        return
    show_map(out)
    report(summary, out)
    print(f"what the subscriber in the other process received: {out / 'received.png'}")
    print(f"detections, analytic map, this map and truth side by side: {out / 'side_by_side.png'}")
    program = "echogrid" if sys.argv[0].endswith("__main__.py") else sys.argv[0]
    print(f"the same drive, moving, in the browser: {program} view --demo")


def demo(out: Path, model: str | None = None, on_progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Plays the shipped drive as fast as the service maps it; files and summary as in `replay`, and the subscriber's received.png."""
    drive = find_drive(Path(str(files("echogrid") / "demo_drive")), None)
    config = on_a_free_port(on_virtual_buses(load_config(drive.config, model)))
    pipeline = Pipeline(config, drive.config)
    recorder = Recorder(pipeline)
    service = Service(pipeline, recorder.take)
    advance = on_progress or (lambda _: None)
    out.mkdir(parents=True, exist_ok=True)
    helper = threading.Thread(target=_play_and_watch, args=(service, drive.log, out, part(advance, 0.0, DRIVEN)), name="player")
    helper.start()
    try:
        service.run()
    finally:
        service.workers.stop.set()
        helper.join()
    truth = load_truth(drive.truth)
    summary = recorder.write(out, truth)
    if truth is not None and truth.map is not None:
        compare(recorder, drive, truth.map, out, part(advance, DRIVEN, 1.0))
    return summary


def compare(recorder: Recorder, drive: Drive, truth: TrueMap, out: Path, on_progress: Callable[[float], None]) -> None:
    """side_by_side.png: all static detections, the analytic map, the map that the service made, and the truth."""
    config = load_config(drive.config, "analytic")
    pipeline = Pipeline(config, drive.config)
    spec = config.grid.spec()
    detections = OccupancyMap(spec)
    log = Log(drive.log)
    for update in pipeline.updates(log.batches()):
        on_progress(log.progress)
        detections.integrate((rasterize(update.static_points, spec) > 0)[0] * np.float32(2), update.ego.odom_from_base)
    maps = (("static detections", detections), ("analytic model", pipeline.mapper.map), ("echogrid", recorder.pipeline.mapper.map))
    panels = []
    for title, occupancy in maps:
        row, column, log_odds = occupancy.whole()
        panels.append(Panel(title, log_odds, (column * spec.cell, row * spec.cell)))
    driven = recorder.way.arrays()[1][:, :2]
    panels.append(Panel("truth", truth.log_odds, truth.origin))
    save(side_by_side(panels, spec.cell, driven), out / "side_by_side.png")


def on_a_free_port(config: Config) -> Config:
    """The same configuration, published on a free port of the loopback."""
    return msgspec.structs.replace(config, publish=msgspec.structs.replace(config.publish, listen=(f"tcp/127.0.0.1:{_free_port()}",)))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _play_and_watch(service: Service, log: Path, out: Path, on_progress: Callable[[float], None]) -> None:
    """Starts the subscriber, plays the log when it is connected, and ends the service when all is mapped."""
    config = service.config
    try:
        service.live.wait(PATIENCE)
        command = [sys.executable, "-c", WATCH, config.publish.listen[0], config.vehicle, str(out)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as watcher:
            try:
                if watcher.stdout is None or watcher.stdout.readline().strip() != "connected":
                    raise EchogridError("the demo's subscriber could not connect to the service")
                player = Player(service, Log(log), on_progress=on_progress)
                player.run(service.workers.stop)
                if player.torn is not None:
                    raise player.torn
            finally:
                service.workers.stop.set()
                watcher.wait(PATIENCE)
    except Exception as error:  # in a thread of its own: hand it to the one who waits for the service
        service.workers.fail(error)


def watch() -> None:
    """The subscriber of an endpoint, a vehicle: receives windows until the service ends, then draws the newest into OUT's received.png."""
    endpoint, vehicle, out = sys.argv[1:]
    with Client(endpoint, vehicle) as client:
        deadline = time.monotonic() + PATIENCE
        while not client.alive():
            if time.monotonic() > deadline:
                raise SystemExit(1)
            time.sleep(0.05)
        sys.stdout.write("connected\n")
        sys.stdout.flush()
        grids: list[Window] = []
        while True:
            grid = client.grid(timeout=0.5)
            if grid is not None:
                grids.append(grid)
            elif not client.alive():
                break
    if grids:
        origin, log_odds = merge(grids)
        save(draw(log_odds, origin, grids[0].cell, np.empty((0, 2))), Path(out) / "received.png")


def merge(grids: list[Window]) -> tuple[tuple[float, float], LogOdds]:
    """Windows put together, newer over older, those of the newest map alone: (x, y) of the corner of cell [0, 0], log-odds."""
    cell = grids[-1].cell
    places = [(round(grid.origin[1] / cell), round(grid.origin[0] / cell), grid) for grid in grids if grid.map == grids[-1].map]
    top, left = min(row for row, _, _ in places), min(column for _, column, _ in places)
    bottom = max(row + grid.occupancy.shape[0] for row, _, grid in places)
    right = max(column + grid.occupancy.shape[1] for _, column, grid in places)
    log_odds = np.zeros((bottom - top, right - left), dtype=np.float32)
    for row, column, grid in places:
        height, width = grid.occupancy.shape
        p = np.clip(grid.occupancy / 100.0, 0.01, 0.99)
        window = np.where(grid.occupancy < 0, 0.0, np.log(p / (1 - p)))
        log_odds[row - top : row - top + height, column - left : column - left + width] = window
    return (left * cell, top * cell), log_odds
