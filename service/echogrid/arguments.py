"""What an option may be, and the options that several commands have or that are many."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from echogrid.config.tables import Publish
from echogrid.recording.foxglove import LOOPBACK, PORT


def seconds(text: str) -> float:
    """How long to listen."""
    return _between(text, 0.1, 3600, "found, expected seconds")


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
    return _between(text, 0.01, 1000, "is not a speed, expected a number")


def _between(text: str, least: float, most: float, expected: str) -> float:
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
