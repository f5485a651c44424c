"""What commands show while they work, on a terminal where the extra `terminal` is installed."""

from __future__ import annotations

import logging
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from echogrid.maps.picture import text

WIDEST = 100  # columns of a map
FIRST_S, NEXT_S = 2.0, 10.0  # until a line of progress, and between two


@contextmanager
def screen(live: bool, plain: bool) -> Iterator[Callable[[Sequence[Sequence[tuple[str, str]]]], None]]:
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
        with Live(console=console, auto_refresh=False) as updated:
            yield lambda lines: updated.update(Text("\n").join(Text.assemble(*line) for line in lines), refresh=True)
    else:
        yield lambda lines: console.print(Text("\n").join(Text.assemble(*line) for line in lines))


@contextmanager
def progress(title: str) -> Iterator[Callable[[float], None]]:
    """A bar on a terminal, if the extra `terminal` is installed; otherwise a line in the log now and then, if it takes long."""
    try:
        from rich.console import Console
        from rich.progress import Progress
    except ImportError:
        yield Lines(title).add
        return
    console = Console(stderr=True)
    if not console.is_terminal:
        yield Lines(title).add
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def part(advance: Callable[[float], None], begin: float, end: float) -> Callable[[float], None]:
    """The same bar for a part of the work, from one share of the whole to another."""
    return lambda share: advance(begin + share * (end - begin))


class Lines:
    """Remembers when the next line is due."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._due = time.monotonic() + FIRST_S

    def add(self, share: float) -> None:
        """How much is done, 0 to 1."""
        if time.monotonic() >= self._due:
            self._due = time.monotonic() + NEXT_S
            logging.getLogger("echogrid").info(f"{self._title}: {share:.0%}")  # not one template: repeats of that would be left out


def coloured() -> bool:
    """Whether what is printed may have colours: on a terminal that has some, and where NO_COLOR does not forbid it."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def show_map(out: Path) -> None:
    """The map that was written into a folder, coarse, where there is a terminal to show it on."""
    if sys.stdout.isatty() and (out / "map.npz").is_file():
        with np.load(out / "map.npz") as file:
            print(text(file["log_odds"], min(WIDEST, shutil.get_terminal_size((WIDEST, 0)).columns), coloured=coloured()))
