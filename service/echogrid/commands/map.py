"""`echogrid map`: stored maps, looked at, converted and merged."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

from echogrid.commands.terminal import coloured, progress
from echogrid.maps.export import export, parse_box
from echogrid.maps.importing import import_map
from echogrid.maps.info import info, lines
from echogrid.maps.merge import Input, merge
from echogrid.maps.picture import text
from echogrid.maps.show import show


def info_command(file: Path, *, as_json: bool) -> None:
    """Prints what a stored map holds. This and the others raise EchogridError."""
    with progress(f"reading {file.name}") as advance:
        document = info(file, advance)
    print(json.dumps(document) if as_json else "\n".join(lines(document, time.time())))


def show_command(file: Path, out: Path | None, *, epoch: int | None, force: bool) -> None:
    """Prints the map as wide as the terminal is."""
    with progress(f"reading {file.name}") as advance:
        seen = show(file, epoch=epoch, out=out, force=force, on_progress=advance)
    print(text(seen, shutil.get_terminal_size((100, 0)).columns, coloured=coloured()))


def export_command(file: Path, out: Path, *, epoch: int | None, form: str | None, mode: str | None, bbox: str | None, force: bool) -> None:
    """Prints what was written. `bbox`: X0,Y0,X1,Y1 in m."""
    box = None if bbox is None else parse_box(bbox)
    with progress(f"export to {out.name}") as advance:
        sentence = export(file, out, epoch=epoch, form=form, mode=mode, box=box, force=force, on_progress=advance)
    print(sentence)


def import_command(file: Path, out: Path, *, vehicle: str, force: bool) -> None:
    """Prints what was written."""
    with progress(f"import of {file.name}") as advance:
        sentence = import_map(file, out, vehicle=vehicle, force=force, on_progress=advance)
    print(sentence)


def merge_command(maps: Sequence[str], out: Path, *, scheduler: str | None, force: bool) -> None:
    """Prints what was written. `maps`: FILE.egmap[@EPOCH][:X,Y,YAW_DEG]."""
    inputs = [Input.parse(one) for one in maps]
    with progress(f"merge into {out.name}") as advance:
        sentence = merge(inputs, out, scheduler=scheduler, force=force, on_progress=advance)
    print(sentence)
