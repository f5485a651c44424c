"""The command line: `echogrid run | status | replay | check | demo`."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from echogrid import __version__
from echogrid.config import Publish
from echogrid.errors import EchogridError
from echogrid.io import journal


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
    replay.add_argument("drive", type=Path, metavar="DRIVE_OR_LOG", help="a drive folder, or a log: .log .blf .asc .trc .csv .db .mf4")
    replay.add_argument("-c", "--config", type=Path, help="default: the drive folder's echogrid.toml")
    replay.add_argument("--out", type=Path, default=Path("out/replay"), help="folder for map, trajectory and summary (default: out/replay)")
    replay.add_argument("--realtime", action="store_true", help="at the bus's pace instead of as fast as it goes")
    replay.set_defaults(command=_replay)

    check = commands.add_parser("check", help="a configuration, and what a recording is worth to it")
    check.add_argument("log", type=Path, nargs="?", metavar="LOG")
    check.add_argument("-c", "--config", type=Path, required=True)
    check.set_defaults(command=_check)

    demo = commands.add_parser("demo", help="the shipped drive: over a CAN bus, through the service, over Zenoh, to a subscriber")
    demo.add_argument("--out", type=Path, default=Path("out/demo"))
    demo.set_defaults(command=_demo)
    for command in (run, replay, demo):
        command.add_argument("--model", help="default, paper, analytic, or the path of an .onnx file; otherwise as the configuration says")
    return parser


def _run(arguments: argparse.Namespace) -> None:
    from echogrid.app import run  # Zenoh is loaded only where it is used

    run(arguments.config, arguments.model)


def _status(arguments: argparse.Namespace) -> None:
    from echogrid.client import Client, Credentials  # Zenoh is loaded only where it is used
    from echogrid.status import as_json, lines, look, silence, watch

    view = as_json if arguments.json else lines
    credentials = Credentials(*arguments.tls) if arguments.tls else None
    with Client(arguments.endpoint, arguments.vehicle, credentials) as client, _screen(arguments.watch, plain=arguments.json) as show:
        if arguments.watch:
            for document, seconds in watch(client):
                if document is not None:
                    show(view(document, client.vehicle))
                elif not arguments.json:
                    show(silence(client.vehicle, seconds))
        document = look(client)
        show(view(document, client.vehicle))
    if document.get("state") != "ok":
        sys.exit(2)


def _replay(arguments: argparse.Namespace) -> None:
    from echogrid.io.drive import find_drive
    from echogrid.replay import replay

    drive = find_drive(arguments.drive, arguments.config)
    with _progress(f"replay {arguments.drive.name}") as advance:
        summary = replay(drive, arguments.out, realtime=arguments.realtime, model=arguments.model, on_progress=advance)
    _report(summary, arguments.out)


def _check(arguments: argparse.Namespace) -> None:
    from echogrid.check import check_log, render
    from echogrid.config import load_config
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
    from echogrid.demo import demo
    from echogrid.io.picture import text

    with _progress("the demo drive, through the service") as advance:
        summary = demo(arguments.out, arguments.model, advance)
    if sys.stdout.isatty():
        with np.load(arguments.out / "map.npz") as file:
            print(text(file["log_odds"], columns=100))
    _report(summary, arguments.out)
    print(f"what the subscriber in the other process received: {arguments.out / 'received.png'}")
    print(f"detections, analytic map, this map and truth side by side: {arguments.out / 'side_by_side.png'}")


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
