"""The command line: `echogrid run | status | view | replay | check | init | map | demo`; what they do is in `commands`.

A command is imported where it is run: `--help` need not wait for Zenoh and ONNX Runtime.
"""

from __future__ import annotations

import argparse
import logging
import math
import sys
from pathlib import Path
from typing import NoReturn

from echogrid import __version__
from echogrid.config.tables import Publish
from echogrid.errors import EchogridError
from echogrid.recording.foxglove import LOOPBACK, PORT
from echogrid.watching import journal


def main() -> None:
    """Exits with 0, or with another code and one sentence on stderr."""
    arguments = _parser().parse_args()
    journal.configure(arguments.log_level)
    try:
        arguments.command(arguments)
    except EchogridError as error:
        _give_up(str(error), error.exit_code)
    except OSError as error:  # a full disk, a folder that may not be written
        _give_up(f"{error.filename or 'the operating system says'}: {error.strerror or error}")
    except KeyboardInterrupt:
        sys.exit(130)


def _give_up(sentence: str, exit_code: int = 1) -> NoReturn:
    """The program's last words, an error in the journal too."""
    text = f"echogrid: {sentence}"
    sys.stderr.write((journal.prefixed(text, logging.ERROR) if journal.to_journal() else text) + "\n")
    sys.exit(exit_code)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="echogrid", description="A car's corner radars on CAN in, one dense occupancy map out.")
    parser.add_argument("--version", action="version", version=f"echogrid {__version__}")
    parser.add_argument("--log-level", choices=journal.LEVELS, default="info", help="the lowest level that is logged (default: info)")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="the service: live CAN buses in, the map on Zenoh out")
    run.add_argument("-c", "--config", type=Path, required=True)
    run.add_argument(
        "--record",
        type=Path,
        metavar="FILE.mcap|BAG",
        help="record frames and all that is published, into a new file or, as a ROS 2 bag, a new folder; in one that exists named by time",
    )
    _foxglove(run)
    run.set_defaults(command=_run)

    status = commands.add_parser(
        "status",
        help="how the running service is doing",
        epilog="Exit code: 0 if the state is ok, 1 without an answer, 2 in any other state.",
    )
    status.add_argument("--endpoint", default=Publish().listen[0], help="where the service listens (default: %(default)s)")
    status.add_argument("--vehicle", help="as in its configuration (default: the one that is there)")
    status.add_argument(
        "--tls", type=Path, nargs=3, metavar=("CA", "CERTIFICATE", "KEY"), help="PEM files of a viewer, for an endpoint tls/HOST:PORT"
    )
    status.add_argument("--watch", action="store_true", help="repeat every second, until Ctrl-C")
    status.add_argument("--json", action="store_true", help="print it as published, one line each")
    status.set_defaults(command=_status)

    _view_parser(commands.add_parser("view", help="the map in the browser: of a running service, a recording or a stored map"))

    replay = commands.add_parser(
        "replay",
        help="a recording through the same chain, into files",
        epilog="Exits with 0, with 3 where the map is empty or not to be trusted, 1 where a file cannot be read.",
    )
    replay.add_argument(
        "drive",
        type=Path,
        metavar="DRIVE_OR_LOG",
        help="a drive folder, or a log: .log .blf .asc .trc .csv .pcap .pcapng .db .mf4 .mcap (.gz, .zst)",
    )
    replay.add_argument("-c", "--config", type=Path, help="default: the drive folder's echogrid.toml")
    replay.add_argument("--out", type=Path, default=Path("out/replay"), help="folder for map, trajectory and summary (default: out/replay)")
    replay.add_argument("--realtime", action="store_true", help="at the bus's pace instead of as fast as possible")
    replay.add_argument("--publish", action="store_true", help="at the bus's pace through the service, and out over Zenoh as `run` would")
    replay.add_argument("--speed", type=_speed, metavar="TIMES", help="with --publish: so many times the bus's pace (default: 1)")
    _foxglove(replay)
    replay.add_argument(
        "--record",
        type=Path,
        metavar="FILE.mcap|BAG",
        help="also record frames and all that is published, into a new file, or a new folder that is a ROS 2 bag",
    )
    replay.add_argument("--store", type=Path, metavar="FILE.egmap", help="also write the map's tiles into this file, as a new epoch")
    replay.set_defaults(command=_replay)

    check = commands.add_parser(
        "check",
        help="a configuration, and what a recording or live buses say is wrong with it",
        epilog="Exits with 0 where nothing wrong was found, 2 where something was, 1 where a file or a bus cannot be read.",
    )
    check.add_argument("log", type=Path, nargs="?", metavar="LOG")
    check.add_argument("-c", "--config", type=Path, required=True)
    check.add_argument("--seconds", type=_seconds, metavar="N", help="instead of a LOG: listen to the configured buses for so long")
    check.add_argument("--json", action="store_true", help="the report as one JSON object")
    check.add_argument("--fix-out", type=Path, metavar="FILE.toml", help="the mended configuration, with its profiles beside it")
    check.add_argument("--report", type=Path, metavar="FILE.html", help="one page with plots")
    check.set_defaults(command=_check)

    init = commands.add_parser(
        "init",
        help="a configuration out of a recording, and DBCs if there are any",
        epilog="Exits with 0 where a check accepts what was written, 2 where something is missing or wrong, 1 where a file cannot be read.",
    )
    init.add_argument("log", type=Path, metavar="LOG")
    init.add_argument(
        "--dbc", type=Path, action="append", default=[], metavar="FILE", help="may be given several times; none: shipped profiles"
    )
    init.add_argument(
        "--out", type=Path, default=Path("echogrid.toml"), metavar="FILE.toml", help="with profiles beside it (default: %(default)s)"
    )
    init.add_argument("--force", action="store_true", help="replace files that are there")
    init.set_defaults(command=_init)

    _map_parsers(commands.add_parser("map", help="stored maps: look, convert, merge").add_subparsers(required=True, metavar="COMMAND"))

    demo = commands.add_parser("demo", help="the shipped drive: over a CAN bus, through the service, over Zenoh, to a subscriber")
    demo.add_argument("--out", type=Path, default=Path("out/demo"))
    demo.set_defaults(command=_demo)
    for command in (run, replay, demo, commands.choices["view"]):
        command.add_argument("--model", help="default, paper, analytic, or the path of an .onnx file; otherwise as the configuration says")
    return parser


def _view_parser(view: argparse.ArgumentParser) -> None:
    view.add_argument(
        "what",
        type=Path,
        nargs="?",
        metavar="WHAT",
        help="a drive folder, a log with -c, an .mcap recording, or a stored map (.egmap .npz .yaml); without it a running service",
    )
    view.add_argument("--demo", action="store_true", help="the shipped drive")
    view.add_argument("-c", "--config", type=Path, help="of a log; default: the drive folder's echogrid.toml")
    view.add_argument("--epoch", type=int, help="of an .egmap file (default: the newest)")
    view.add_argument("--endpoint", default=Publish().listen[0], help="where the service listens (default: %(default)s)")
    view.add_argument("--vehicle", default="car", help="as in its configuration (default: %(default)s)")
    view.add_argument("--tls", type=Path, nargs=3, metavar=("CA", "CERTIFICATE", "KEY"), help="PEM files, for an endpoint tls/HOST:PORT")
    view.add_argument(
        "--listen", type=_address, default=(LOOPBACK, 8890), metavar="[HOST:]PORT", help="of the page (default: 127.0.0.1:8890)"
    )
    view.add_argument("--token", type=Path, metavar="FILE", help="holds what viewers have to show; needed where other machines can come")
    view.add_argument("--certificate", type=Path, nargs=2, metavar=("CERT", "KEY"), help="PEM files: the page over HTTPS")
    view.add_argument("--plaintext", action="store_true", help="other machines may come without HTTPS: on a network of your own")
    view.set_defaults(command=_view)


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
    export.add_argument("--bbox", metavar="X0,Y0,X1,Y1", help="only this part, m; write --bbox=… if it starts with a minus")
    export.set_defaults(command=_map_export)

    importing = commands.add_parser("import", help="a map of another format as a store")
    importing.add_argument("file", type=Path, metavar="IN", help=".npz, or the .yaml of a map_server map")
    importing.add_argument("out", type=Path, metavar="OUT.egmap")
    importing.add_argument("--vehicle", default="imported", help="vehicle of the map (default: %(default)s)")
    importing.set_defaults(command=_map_import)

    merge = commands.add_parser(
        "merge", help="maps of several drives into one", fromfile_prefix_chars="@", epilog="@LIST.txt stands for the lines of a file."
    )
    merge.add_argument("out", type=Path, metavar="OUT.egmap")
    merge.add_argument(
        "maps", nargs="+", metavar="FILE.egmap[@EPOCH][:X,Y,YAW_DEG]", help="pose of its origin in the merged map, m and degrees"
    )
    merge.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster whose workers find the files under the same paths")
    merge.set_defaults(command=_map_merge)

    for command in (show, export):
        command.add_argument("--epoch", type=int, help="default: the newest")
    for command in (show, export, importing, merge):
        command.add_argument("--force", action="store_true", help="replace an existing output")


def _seconds(text: str) -> float:
    """How long to listen."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.1 <= seconds <= 3600:
        raise argparse.ArgumentTypeError(f"'{text}' found, expected seconds from 0.1 to 3600")
    return seconds


def _foxglove(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--foxglove",
        type=_address,
        nargs="?",
        const=(LOOPBACK, PORT),
        metavar="[HOST:]PORT",
        help="a live view for Foxglove (default: 127.0.0.1:8765)",
    )


def _speed(text: str) -> float:
    """How many times as fast."""
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not 0.01 <= speed <= 1000:
        raise argparse.ArgumentTypeError(f"'{text}' is not a speed, expected a number from 0.01 to 1000")
    return speed


def _address(text: str) -> tuple[str, int]:
    """Host and port; on this machine alone unless another host is written out."""
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not port.isdecimal() or int(port) > 65535 or bool(colon) != bool(host):
        raise argparse.ArgumentTypeError(f"'{text}' is not an address, expected PORT or HOST:PORT")
    return host or LOOPBACK, int(port)


def _run(arguments: argparse.Namespace) -> None:
    from echogrid.commands.run import run

    run(arguments.config, arguments.model, arguments.record, arguments.foxglove)


def _status(arguments: argparse.Namespace) -> None:
    from echogrid.commands.status import command

    if not command(arguments.endpoint, arguments.vehicle, arguments.tls, going_on=arguments.watch, as_json=arguments.json):
        sys.exit(2)


def _replay(arguments: argparse.Namespace) -> None:
    from echogrid.commands import publish
    from echogrid.commands.replay import command

    if arguments.publish:
        speed, options = arguments.speed or 1.0, {name: getattr(arguments, name) for name in ("model", "record", "store", "foxglove")}
        if not publish.command(arguments.drive, arguments.config, arguments.out, speed=speed, **options):
            sys.exit(3)
        return
    for option in ("speed", "foxglove"):
        if getattr(arguments, option) is not None:
            raise EchogridError(f"--{option}: needs --publish")
    if not command(
        arguments.drive,
        arguments.config,
        arguments.out,
        realtime=arguments.realtime,
        model=arguments.model,
        record=arguments.record,
        store=arguments.store,
    ):
        sys.exit(3)


def _view(arguments: argparse.Namespace) -> None:
    from echogrid.commands.view import Wanted, command, demo_drive

    if arguments.demo and arguments.what is not None:
        raise EchogridError(f"--demo: found with {arguments.what}, expected one of them")
    path = demo_drive() if arguments.demo else arguments.what
    names = ("config", "model", "epoch", "endpoint", "vehicle", "tls")
    wanted = Wanted(path, **{name: getattr(arguments, name) for name in names})
    command(wanted, arguments.listen, arguments.token, arguments.certificate, plaintext=arguments.plaintext)


def _check(arguments: argparse.Namespace) -> None:
    from echogrid.commands.check import command

    options = {"as_json": arguments.json, "fix_out": arguments.fix_out, "page": arguments.report}
    if not command(arguments.config, arguments.log, seconds=arguments.seconds, **options):
        sys.exit(2)


def _init(arguments: argparse.Namespace) -> None:
    from echogrid.commands.init import command

    if not command(arguments.log, arguments.dbc, arguments.out, force=arguments.force):
        sys.exit(2)


def _demo(arguments: argparse.Namespace) -> None:
    from echogrid.commands.demo import command

    command(arguments.out, arguments.model)


def _map_info(arguments: argparse.Namespace) -> None:
    from echogrid.commands.map import info_command

    info_command(arguments.file, as_json=arguments.json)


def _map_show(arguments: argparse.Namespace) -> None:
    from echogrid.commands.map import show_command

    show_command(arguments.file, arguments.out, epoch=arguments.epoch, force=arguments.force)


def _map_export(arguments: argparse.Namespace) -> None:
    from echogrid.commands.map import export_command

    options = {"epoch": arguments.epoch, "form": arguments.format, "mode": arguments.mode, "force": arguments.force}
    export_command(arguments.file, arguments.out, bbox=arguments.bbox, **options)


def _map_import(arguments: argparse.Namespace) -> None:
    from echogrid.commands.map import import_command

    import_command(arguments.file, arguments.out, vehicle=arguments.vehicle, force=arguments.force)


def _map_merge(arguments: argparse.Namespace) -> None:
    from echogrid.commands.map import merge_command

    merge_command(arguments.maps, arguments.out, scheduler=arguments.scheduler, force=arguments.force)
