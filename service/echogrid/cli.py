"""The command line: `echogrid run | status | replay | check | map | demo`."""

from __future__ import annotations

import argparse
import json
import logging
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from echogrid import __version__
from echogrid.config.tables import Publish
from echogrid.errors import EchogridError
from echogrid.recording.foxglove import LOOPBACK, PORT
from echogrid.watching import journal


def main() -> None:
    """Exits with 0, or with 1 and one sentence on stderr."""
    arguments = _parser().parse_args()
    journal.configure(arguments.log_level)
    try:
        arguments.command(arguments)
    except EchogridError as error:
        _give_up(str(error))
    except OSError as error:  # a full disk, a folder that may not be written
        _give_up(f"{error.filename or 'the operating system says'}: {error.strerror or error}")
    except KeyboardInterrupt:
        sys.exit(130)


def _give_up(sentence: str) -> NoReturn:
    """The program's last words, an error in the journal too."""
    text = f"echogrid: {sentence}"
    sys.exit(journal.prefixed(text, logging.ERROR) if journal.to_journal() else text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="echogrid", description="A car's corner radars on CAN in, one dense occupancy map out.")
    parser.add_argument("--version", action="version", version=f"echogrid {__version__}")
    parser.add_argument("--log-level", choices=journal.LEVELS, default="info", help="what is logged at all (default: info)")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="the service: live CAN buses in, the map on Zenoh out")
    run.add_argument("-c", "--config", type=Path, required=True)
    run.add_argument(
        "--record",
        type=Path,
        metavar="FILE.mcap",
        help="frames and all that is published, into a new file; in a folder it is named by the time",
    )
    run.add_argument(
        "--foxglove",
        type=_address,
        nargs="?",
        const=(LOOPBACK, PORT),
        metavar="[HOST:]PORT",
        help="a live view for Foxglove (default: 127.0.0.1:8765)",
    )
    run.set_defaults(command=_run)

    status = commands.add_parser(
        "status",
        help="a look at the running service",
        epilog="Exits with 0 where the state is ok, 1 where nobody answers, 2 in any other state.",
    )
    status.add_argument("--endpoint", default=Publish().listen[0], help="where the service listens (default: %(default)s)")
    status.add_argument("--vehicle", default="car", help="as in its configuration (default: %(default)s)")
    status.add_argument(
        "--tls", type=Path, nargs=3, metavar=("CA", "CERTIFICATE", "KEY"), help="PEM files of a viewer, for an endpoint tls/HOST:PORT"
    )
    status.add_argument("--watch", action="store_true", help="go on looking, until Ctrl-C")
    status.add_argument("--json", action="store_true", help="as it is published, one line each")
    status.set_defaults(command=_status)

    replay = commands.add_parser("replay", help="a recording through the same chain, into files")
    replay.add_argument(
        "drive", type=Path, metavar="DRIVE_OR_LOG", help="a drive folder, or a log: .log .blf .asc .trc .csv .db .mf4 .mcap"
    )
    replay.add_argument("-c", "--config", type=Path, help="default: the drive folder's echogrid.toml")
    replay.add_argument("--out", type=Path, default=Path("out/replay"), help="folder for map, trajectory and summary (default: out/replay)")
    replay.add_argument("--realtime", action="store_true", help="at the bus's pace instead of as fast as it goes")
    replay.add_argument(
        "--record", type=Path, metavar="FILE.mcap", help="frames and all that is published of them, into a new file as well"
    )
    replay.add_argument("--store", type=Path, metavar="FILE.egmap", help="the map's tiles into this file as well, as a new epoch of it")
    replay.set_defaults(command=_replay)

    check = commands.add_parser("check", help="a configuration, and what a recording is worth to it")
    check.add_argument("log", type=Path, nargs="?", metavar="LOG")
    check.add_argument("-c", "--config", type=Path, required=True)
    check.set_defaults(command=_check)

    _map_parsers(commands.add_parser("map", help="stored maps: look, convert, merge").add_subparsers(required=True, metavar="COMMAND"))

    demo = commands.add_parser("demo", help="the shipped drive: over a CAN bus, through the service, over Zenoh, to a subscriber")
    demo.add_argument("--out", type=Path, default=Path("out/demo"))
    demo.set_defaults(command=_demo)
    for command in (run, replay, demo):
        command.add_argument("--model", help="default, paper, analytic, or the path of an .onnx file; otherwise as the configuration says")
    return parser


def _map_parsers(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    info = commands.add_parser("info", help="what a stored map holds")
    info.add_argument("file", type=Path, metavar="FILE.egmap")
    info.add_argument("--json", action="store_true", help="one JSON object")
    info.set_defaults(command=_map_info)

    show = commands.add_parser("show", help="a map in the terminal, or as a picture")
    show.add_argument("file", type=Path, metavar="FILE", help=".egmap, .npz, or the .yaml of a map_server map")
    show.add_argument("--out", type=Path, metavar="PICTURE.png", help="with a scale, at most 1600 pixels along a side")
    show.set_defaults(command=_map_show)

    export = commands.add_parser("export", help="a stored map in other formats, or one epoch as a store of its own")
    export.add_argument("file", type=Path, metavar="FILE.egmap")
    export.add_argument("out", type=Path, metavar="OUT", help=".yaml (map_server, with its picture), .png, .npz or .egmap")
    export.add_argument("--format", choices=("ros", "png", "npz", "egmap"), help="default: by the suffix of OUT")
    export.add_argument("--mode", choices=("trinary", "scale", "raw"), help="of map_server (default: trinary)")
    export.add_argument("--bbox", metavar="X0,Y0,X1,Y1", help="this part alone, m; write --bbox=… where it begins with a minus")
    export.set_defaults(command=_map_export)

    importing = commands.add_parser("import", help="a map of another format as a store")
    importing.add_argument("file", type=Path, metavar="IN", help=".npz, or the .yaml of a map_server map")
    importing.add_argument("out", type=Path, metavar="OUT.egmap")
    importing.add_argument("--vehicle", default="imported", help="whose map it is (default: %(default)s)")
    importing.set_defaults(command=_map_import)

    merge = commands.add_parser(
        "merge", help="maps of several drives into one", fromfile_prefix_chars="@", epilog="@LIST.txt stands for the lines of a file."
    )
    merge.add_argument("out", type=Path, metavar="OUT.egmap")
    merge.add_argument(
        "maps", nargs="+", metavar="FILE.egmap[@EPOCH][:X,Y,YAW_DEG]", help="where its origin lies in the merged map, m and degrees"
    )
    merge.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster whose workers find the files under the same paths")
    merge.set_defaults(command=_map_merge)

    for command in (show, export):
        command.add_argument("--epoch", type=int, help="default: the newest")
    for command in (show, export, importing, merge):
        command.add_argument("--force", action="store_true", help="replace an output that is there already")


def _address(text: str) -> tuple[str, int]:
    """Host and port; on this machine alone unless another host is written out."""
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not port.isdecimal() or int(port) > 65535 or bool(colon) != bool(host):
        raise argparse.ArgumentTypeError(f"'{text}' is no address, expected PORT or HOST:PORT")
    return host or LOOPBACK, int(port)


def _run(arguments: argparse.Namespace) -> None:
    from echogrid.live.service import run  # Zenoh is loaded only where it is used

    run(arguments.config, arguments.model, arguments.record, arguments.foxglove)


def _status(arguments: argparse.Namespace) -> None:
    from echogrid.client import Client, Credentials  # Zenoh is loaded only where it is used
    from echogrid.watching.status_text import as_json, lines, look, silence, watch

    view = as_json if arguments.json else lines
    credentials = Credentials(*arguments.tls) if arguments.tls else None
    with Client(arguments.endpoint, arguments.vehicle, credentials) as client, _screen(arguments.watch, plain=arguments.json) as show:
        if arguments.watch:
            interrupted = threading.Event()  # as an exception, Ctrl-C may be lost in a callback out of foreign code
            signal.signal(signal.SIGINT, lambda *_: interrupted.set())
            for document, seconds in watch(client):
                if interrupted.is_set():
                    raise KeyboardInterrupt
                if document is not None:
                    show(view(document, client.vehicle))
                elif not arguments.json:
                    show(silence(client.vehicle, seconds))
        document = look(client)
        show(view(document, client.vehicle))
    if document.get("state") != "ok":
        sys.exit(2)


def _replay(arguments: argparse.Namespace) -> None:
    from echogrid.commands.replay import replay
    from echogrid.logs.drive import find_drive

    drive = find_drive(arguments.drive, arguments.config)
    with _progress(f"replay {arguments.drive.name}") as advance:
        summary = replay(
            drive,
            arguments.out,
            realtime=arguments.realtime,
            model=arguments.model,
            record=arguments.record,
            store=arguments.store,
            on_progress=advance,
        )
    _report(summary, arguments.out)


def _check(arguments: argparse.Namespace) -> None:
    from echogrid.commands.check import check_log, render
    from echogrid.config.loading import load_config
    from echogrid.pipeline import Pipeline

    config = load_config(arguments.config)
    readers = Pipeline(config, arguments.config).signals.readers
    print(f"{arguments.config}: {len(config.radar)} radars and ego motion on {len(config.bus)} buses, {len(readers)} ids are read")
    if arguments.log is None:
        return
    report = check_log(config, arguments.config, arguments.log)
    print(render(report))
    complaints = report.complaints()
    if complaints:
        raise EchogridError(f"{arguments.log}: " + "; ".join(complaints))
    print(f"{arguments.log}: all is there")


def _demo(arguments: argparse.Namespace) -> None:
    from echogrid.commands.demo import demo
    from echogrid.maps.picture import text

    with _progress("the demo drive, through the service") as advance:
        summary = demo(arguments.out, arguments.model, advance)
    if sys.stdout.isatty():
        with np.load(arguments.out / "map.npz") as file:
            print(text(file["log_odds"], columns=100))
    _report(summary, arguments.out)
    print(f"what the subscriber in the other process received: {arguments.out / 'received.png'}")
    print(f"detections, analytic map, this map and truth side by side: {arguments.out / 'side_by_side.png'}")


def _map_info(arguments: argparse.Namespace) -> None:
    from echogrid.maps.info import info, lines

    with _progress(f"reading {arguments.file.name}") as advance:
        document = info(arguments.file, advance)
    print(json.dumps(document) if arguments.json else "\n".join(lines(document, time.time())))


def _map_show(arguments: argparse.Namespace) -> None:
    from echogrid.maps.picture import text
    from echogrid.maps.show import show

    with _progress(f"reading {arguments.file.name}") as advance:
        seen = show(arguments.file, epoch=arguments.epoch, out=arguments.out, force=arguments.force, on_progress=advance)
    print(text(seen, columns=shutil.get_terminal_size((100, 0)).columns))


def _map_export(arguments: argparse.Namespace) -> None:
    from echogrid.maps.export import export, parse_box

    box = None if arguments.bbox is None else parse_box(arguments.bbox)
    options = {"epoch": arguments.epoch, "form": arguments.format, "mode": arguments.mode, "box": box, "force": arguments.force}
    with _progress(f"export to {arguments.out.name}") as advance:
        sentence = export(arguments.file, arguments.out, **options, on_progress=advance)
    print(sentence)


def _map_import(arguments: argparse.Namespace) -> None:
    from echogrid.maps.importing import import_map

    with _progress(f"import of {arguments.file.name}") as advance:
        sentence = import_map(arguments.file, arguments.out, vehicle=arguments.vehicle, force=arguments.force, on_progress=advance)
    print(sentence)


def _map_merge(arguments: argparse.Namespace) -> None:
    from echogrid.maps.merge import Input, merge

    inputs = [Input.parse(text) for text in arguments.maps]
    with _progress(f"merge into {arguments.out.name}") as advance:
        sentence = merge(inputs, arguments.out, scheduler=arguments.scheduler, force=arguments.force, on_progress=advance)
    print(sentence)


def _report(summary: dict[str, Any], out: Path) -> None:
    faster = summary["drive_s"] / max(summary["wall_s"], 1e-9)
    scans = sum(counts["complete"] for counts in summary["scans"].values())
    print(f"{summary['drive_s']:.1f} s and {summary['distance_m']:.0f} m driven, {scans} scans in {summary['cycles']} map updates")
    print(f"{summary['wall_s']:.1f} s on this machine ({faster:.0f} times as fast), {summary['cycle_ms']['p50']:.1f} ms an update")
    if "trajectory_rmse_m" in summary:
        print(f"dead reckoning is {summary['trajectory_rmse_m']:.2f} m RMSE from the true positions")
    print(f"map: {out / 'map.png'}, numbers: {out / 'summary.json'}")


@contextmanager
def _screen(live: bool, plain: bool) -> Iterator[Callable[[Sequence[Sequence[tuple[str, str]]]], None]]:
    """Shows lines of (text, style); in colours, and where `live` over the last ones, on a terminal if the extra `terminal` is installed."""

    def write(lines: Sequence[Sequence[tuple[str, str]]]) -> None:
        print("\n".join("".join(text for text, _ in line) for line in lines), flush=True)

    try:
        from rich.console import Console
        from rich.live import Live
        from rich.text import Text
    except ImportError:
        yield write
        return
    console = Console()
    if plain or not console.is_terminal:
        yield write
    elif live:
        with Live(console=console, auto_refresh=False) as screen:
            yield lambda lines: screen.update(Text("\n").join(Text.assemble(*line) for line in lines), refresh=True)
    else:
        yield lambda lines: console.print(Text("\n").join(Text.assemble(*line) for line in lines))


@contextmanager
def _progress(title: str) -> Iterator[Callable[[float], None] | None]:
    """A bar on a terminal, if the extra `terminal` is installed; otherwise nothing."""
    try:
        from rich.console import Console
        from rich.progress import Progress
    except ImportError:
        yield None
        return
    console = Console(stderr=True)
    with Progress(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)
