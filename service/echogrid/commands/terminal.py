"""What commands show while they work, on a terminal where the extra `terminal` is installed."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from echogrid.maps.picture import text

WIDEST = 100  # columns of a map


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
def progress(title: str) -> Iterator[Callable[[float], None] | None]:
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


def coloured() -> bool:
    """Whether what is printed may have colours: on a terminal that has some, and where NO_COLOR does not forbid it."""
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def show_map(out: Path) -> None:
    """The map that was written into a folder, coarse, where there is a terminal to show it on."""
    if sys.stdout.isatty() and (out / "map.npz").is_file():
        with np.load(out / "map.npz") as file:
            print(text(file["log_odds"], min(WIDEST, shutil.get_terminal_size((WIDEST, 0)).columns), coloured=coloured()))
