"""The command line: `echogrid run | status | view | replay | check | init | map | demo | bench`; what they do is in `commands`.

A command is imported where it is run: `--help` need not wait for Zenoh and ONNX Runtime.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
from pathlib import Path
from typing import NoReturn

from echogrid import arguments
from echogrid.config.tables import Publish
from echogrid.errors import EchogridError
from echogrid.files import sentence
from echogrid.watching import journal


def main() -> None:
    """Exits with 0, or with another code and one sentence on stderr."""
    arguments.any_terminal()
    parser = _parser()
    if "_ARGCOMPLETE" in os.environ:
        arguments.complete(parser)
    given = parser.parse_args()
    sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # python-can would import it: a second, 86 MiB; library.read_mf4 lets it in
    journal.configure(given.log_level)
    try:
        given.command(given)
        sys.stdout.flush()
    except EchogridError as error:
        _give_up(str(error), error.exit_code)
    except BrokenPipeError:
        arguments.unread()
        sys.exit(141)
    except OSError as error:  # a full disk, a folder that may not be written
        _give_up(sentence(error))


def _give_up(sentence: str, exit_code: int = 1) -> NoReturn:
    """The program's last words, an error in the journal too."""
    text = f"echogrid: {sentence}"
    sys.stderr.write((journal.prefixed(text, logging.ERROR) if journal.to_journal() else text) + "\n")
    sys.exit(exit_code)


def _parser() -> argparse.ArgumentParser:
    parser = arguments.Parser(prog="echogrid", description="A car's corner radars on CAN in, one dense occupancy map out.")
    parser.add_argument("--version", action=arguments.Version)
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
    arguments.add_foxglove(run)
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

    view = commands.add_parser("view", help="the map in the browser: of a running service, a recording or a stored map")
    arguments.add_view(view)
    view.set_defaults(command=_view)

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
    replay.add_argument("--speed", type=arguments.speed, metavar="TIMES", help="with --publish: so many times the bus's pace (default: 1)")
    arguments.add_foxglove(replay)
    replay.add_argument(
        "--record",
        type=Path,
        metavar="FILE.mcap|BAG",
        help="also record frames and all that is published, into a new file, or a new folder that is a ROS 2 bag",
    )
    replay.add_argument("--store", type=Path, metavar="FILE.egmap", help="also write the map's tiles into this file, as a new epoch")
    replay.add_argument(
        "--learn-first",
        action="store_true",
        help="go through it twice: for what wheels, yaw rate and mounts are off by, then for the map, corrected from its start on",
    )
    replay.set_defaults(command=_replay)

    check = commands.add_parser(
        "check",
        help="a configuration, and what a recording or live buses say is wrong with it",
        epilog="Exits with 0 where nothing wrong was found, 2 where something was, 1 where a file or a bus cannot be read.",
    )
    check.add_argument("log", type=Path, nargs="?", metavar="LOG")
    check.add_argument("-c", "--config", type=Path, required=True)
    check.add_argument(
        "--seconds", type=arguments.seconds, metavar="N", help="instead of a LOG: listen to the configured buses for so long"
    )
    check.add_argument("--fix-out", type=Path, metavar="FILE.toml", help="the mended configuration, with its profiles beside it")
    check.add_argument("--force", action="store_true", help="replace files of --fix-out and --report that are there")
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

    bench = commands.add_parser("bench", help="what each part of a map update takes on this machine")
    bench.add_argument("drive", type=Path, nargs="?", metavar="DRIVE_OR_LOG", help="default: the shipped drive")
    bench.add_argument("-c", "--config", type=Path, help="default: the drive folder's echogrid.toml")
    bench.add_argument("--seconds", type=arguments.seconds, default=30.0, metavar="N", help="of the drive (default: 30)")
    bench.set_defaults(command=_bench)
    for command in (replay, check, init, demo, bench):
        command.add_argument("--json", action="store_true", help="what is printed as one JSON object")
    for command in (run, view, replay, demo, bench):
        command.add_argument("--model", help="default, paper, analytic, or the path of an .onnx file; otherwise as the configuration says")
    return parser


def _map_parsers(commands: argparse._SubParsersAction[arguments.Parser]) -> None:
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


def _run(given: argparse.Namespace) -> None:
    from echogrid.commands.run import run

    run(given.config, given.model, given.record, given.foxglove)


def _status(given: argparse.Namespace) -> None:
    from echogrid.commands.status import command

    if not command(given.endpoint, given.vehicle, given.tls, going_on=given.watch, as_json=given.json):
        sys.exit(2)


def _replay(given: argparse.Namespace) -> None:
    from echogrid.commands.replay import command
    from echogrid.commands.showing import publish

    if given.publish and given.learn_first:
        raise EchogridError("--learn-first: found with --publish, expected one of them")
    if given.publish:
        speed, options = given.speed or 1.0, {name: getattr(given, name) for name in ("model", "record", "store", "foxglove")}
        if not publish.command(given.drive, given.config, given.out, speed=speed, as_json=given.json, **options):
            sys.exit(3)
        return
    for option in ("speed", "foxglove"):
        if getattr(given, option) is not None:
            raise EchogridError(f"--{option}: needs --publish")
    if not command(
        given.drive,
        given.config,
        given.out,
        realtime=given.realtime,
        model=given.model,
        record=given.record,
        store=given.store,
        as_json=given.json,
        learn_first=given.learn_first,
    ):
        sys.exit(3)


def _view(given: argparse.Namespace) -> None:
    from echogrid.commands.showing.view import Wanted, command, demo_drive

    if given.demo and given.what is not None:
        raise EchogridError(f"--demo: found with {given.what}, expected one of them")
    path = demo_drive() if given.demo else given.what
    names = ("config", "model", "epoch", "endpoint", "vehicle", "tls")
    wanted = Wanted(path, **{name: getattr(given, name) for name in names})
    command(wanted, given.listen, given.token, given.certificate, plaintext=given.plaintext)


def _check(given: argparse.Namespace) -> None:
    from echogrid.commands.check import command

    options = {"as_json": given.json, "fix_out": given.fix_out, "page": given.report, "force": given.force}
    if not command(given.config, given.log, seconds=given.seconds, **options):
        sys.exit(2)


def _init(given: argparse.Namespace) -> None:
    from echogrid.commands.init import command

    if not command(given.log, given.dbc, given.out, force=given.force, as_json=given.json):
        sys.exit(2)


def _demo(given: argparse.Namespace) -> None:
    from echogrid.commands.demo import command

    command(given.out, given.model, as_json=given.json)


def _bench(given: argparse.Namespace) -> None:
    from echogrid.commands.measuring.bench import command

    command(given.drive, given.config, given.model, given.seconds, as_json=given.json)


def _map_info(given: argparse.Namespace) -> None:
    from echogrid.commands.map import info_command

    info_command(given.file, as_json=given.json)


def _map_show(given: argparse.Namespace) -> None:
    from echogrid.commands.map import show_command

    show_command(given.file, given.out, epoch=given.epoch, force=given.force)


def _map_export(given: argparse.Namespace) -> None:
    from echogrid.commands.map import export_command

    options = {"epoch": given.epoch, "form": given.format, "mode": given.mode, "force": given.force}
    export_command(given.file, given.out, bbox=given.bbox, **options)


def _map_import(given: argparse.Namespace) -> None:
    from echogrid.commands.map import import_command

    import_command(given.file, given.out, vehicle=given.vehicle, force=given.force)


def _map_merge(given: argparse.Namespace) -> None:
    from echogrid.commands.map import merge_command

    merge_command(given.maps, given.out, scheduler=given.scheduler, force=given.force)
