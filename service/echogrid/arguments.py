"""What an option may be, and the options that several commands have or that are many."""

from __future__ import annotations

import argparse
import difflib
import io
import math
import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from echogrid.config.tables import Publish
from echogrid.recording.foxglove import LOOPBACK, PORT

# What `COMMAND --help` ends with.
EXAMPLES = {
    "run": ("run -c echogrid.toml", "run -c echogrid.toml --record /var/lib/echogrid"),
    "status": ("status", "status --watch", "status --json | jq .state"),
    "view": ("view --demo", "view", "view drives/monday", "view can.blf -c echogrid.toml", "view map.egmap"),
    "replay": (
        "replay drives/monday",
        "replay can.blf -c echogrid.toml --out out/monday",
        "replay drives/monday --publish --speed 4",
        "replay drives/monday --json | jq .not_to_be_trusted",
    ),
    "check": ("check -c echogrid.toml", "check -c echogrid.toml can.blf --fix-out mended.toml", "check -c echogrid.toml --seconds 20"),
    "init": ("init can.blf", "init can.blf --dbc radar.dbc --dbc car.dbc --out car.toml"),
    "": ("demo", "check -c echogrid.toml drive.blf", "replay drive.blf -c echogrid.toml", "run -c echogrid.toml", "status --watch"),
    "map": ("map show map.egmap", "map export map.egmap map.yaml", "map merge all.egmap monday.egmap tuesday.egmap:12,-3,90"),
    "map info": ("map info map.egmap", "map info map.egmap --json | jq '.epochs[-1].area_m2'"),
    "map show": ("map show map.egmap", "map show map.yaml --out map.png"),
    "map export": ("map export map.egmap map.yaml --mode raw", "map export map.egmap part.png --bbox=-20,-20,80,40"),
    "map import": ("map import map.yaml map.egmap",),
    "map merge": ("map merge all.egmap monday.egmap tuesday.egmap@2:12,-3,90", "map merge all.egmap @list.txt"),
    "demo": ("demo", "demo --model analytic --out out/analytic", "demo --json | jq .state"),
    "bench": ("bench", "bench --json", "bench drives/monday --model analytic"),
}
OPTION_OF = {".toml": "--config", ".dbc": "--dbc", ".kcd": "--dbc", ".sym": "--dbc", ".arxml": "--dbc"}  # by what a file's name ends in


class Parser(argparse.ArgumentParser):
    """Says what a word that it does not know may have been meant to be, and ends each command's help with examples."""

    examples: Mapping[str, Sequence[str]] = EXAMPLES  # by the command's words
    used = False  # whether this command was typed

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        self.used = True
        if "" in (sys.argv[1:] if args is None else args):  # as a path it would be the working folder
            self.error("an empty word found, expected a name: is a variable of the shell not set?")
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        word, known = "", []
        if unknown := re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message):
            own = self._option_string_actions if message.startswith("argument COMMAND") else ()  # `echogrid help`
            word, known = unknown[1], [*re.findall(r"[\w.-]+", unknown[2]), *own]
        elif unknown := re.search(r"unrecognized arguments: (?:.* )?(--[\w-]+)", message):
            word, known = unknown[1], sorted(self._options())
            if word in known:  # of another place
                message += f": {word} stands {'before' if word in self._option_string_actions else 'behind'} the command"
                known = []
        elif stray := re.fullmatch(r"unrecognized arguments: ([^-].*)", message):
            message = f"too many: {stray[1]}; {self._takes()}{self._option_for(stray[1])}"
        elif unread := re.fullmatch(r"\[Errno \d+\] (.*): ('.*')", message):
            message = f"{unread[2][1:-1]}: cannot be read: {unread[1]}"
        near = difflib.get_close_matches(word, known, n=1)
        super().error(message + (f"; did you mean '{near[0]}'?" if near else ""))

    def convert_arg_line_to_args(self, arg_line: str) -> list[str]:
        """Of a line of @LIST.txt: nothing of empty ones and of comments."""
        line = arg_line.strip()
        return [line] if line and not line.startswith("#") else []

    def format_help(self) -> str:
        program, _, command = self.prog.partition(" ")
        lines = [f"  {program} {example}" for example in self.examples.get(command, ())]
        return super().format_help() + ("\n".join(("\nexamples:", *lines)) + "\n" if lines else "")

    def _takes(self) -> str:
        """How many files, folders and words the command that was typed takes, as half a sentence."""
        own = []
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                commands: Iterable[Parser] = action.choices.values()
                return next(command._takes() for command in commands if command.used)
            own += [] if action.option_strings else [str(action.metavar or action.dest)]
        return f"{self.prog} takes {' and '.join(f'one {name}' for name in own)}" if own else f"{self.prog} takes options alone"

    def _option_for(self, words: str) -> str:
        """Which option of the command that was typed takes such a file, as the end of a sentence."""
        options = {option for ending, option in OPTION_OF.items() if any(word.lower().endswith(ending) for word in words.split())}
        given = sorted(options & self._options())
        return f", a {given[0].removeprefix('--')} file with {given[0]}" if given else ""

    def _options(self) -> set[str]:
        """Long ones, those of the command that was typed too."""
        found: set[str] = set()
        for action in self._actions:
            found.update(option for option in action.option_strings if option.startswith("--"))
            if isinstance(action, argparse._SubParsersAction):
                found.update(*(command._options() for command in action.choices.values() if command.used))
        return found


class Version(argparse.Action):
    """Prints it and ends the program."""

    def __init__(self, option_strings: list[str], dest: str) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help="show the version and end")

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from echogrid import __version__

        sys.stdout.write(f"{parser.prog} {__version__}\n")
        parser.exit()


def complete(parser: argparse.ArgumentParser) -> None:
    """Answers a shell that asks how a line goes on, and ends the program; nothing where argcomplete is not installed."""
    try:
        import argcomplete
    except ImportError:
        return
    argcomplete.autocomplete(parser)


def seconds(text: str) -> float:
    """How long to listen."""
    return between(text, 0.1, 3600, "found, expected seconds")


def add_foxglove(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--foxglove",
        type=address,
        nargs="?",
        const=(LOOPBACK, PORT),
        metavar="[HOST:]PORT",
        help="a live view for Foxglove (default: 127.0.0.1:8765)",
    )


def speed(text: str) -> float:
    """How many times as fast."""
    return between(text, 0.01, 1000, "is not a speed, expected a number")


def between(text: str, least: float, most: float, expected: str) -> float:
    """A number of what is typed; `expected`: what else is said of it. Raises ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"'{text}' {expected} from {least} to {most}")
    return value


def address(text: str) -> tuple[str, int]:
    """Host and port; on this machine alone unless another host is written out."""
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not port.isdecimal() or int(port) > 65535 or bool(colon) != bool(host):
        raise argparse.ArgumentTypeError(f"'{text}' is not an address, expected PORT or HOST:PORT")
    return host or LOOPBACK, int(port)


def add_view(view: argparse.ArgumentParser) -> None:
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
    view.add_argument("--vehicle", help="as in its configuration (default: the one that is there)")
    view.add_argument("--tls", type=Path, nargs=3, metavar=("CA", "CERTIFICATE", "KEY"), help="PEM files, for an endpoint tls/HOST:PORT")
    view.add_argument(
        "--listen", type=address, default=(LOOPBACK, 8890), metavar="[HOST:]PORT", help="of the page (default: 127.0.0.1:8890)"
    )
    view.add_argument("--token", type=Path, metavar="FILE", help="holds what viewers have to show; needed where other machines can come")
    view.add_argument("--certificate", type=Path, nargs=2, metavar=("CERT", "KEY"), help="PEM files: the page over HTTPS")
    view.add_argument("--plaintext", action="store_true", help="other machines may come without HTTPS: on a network of your own")


def any_terminal() -> None:
    """What a terminal's code page, or a file's name, has no letter for is printed as a question mark."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def unread() -> None:
    """Whoever read stdout has left, as in `| head`, which is no error: what was still to come goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
