"""Pictures of what was scored: maps of a drive side by side with the detections that they were not shown, frames beside the lidar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from echogrid.core.messages import Floats
from echogrid.maps.picture import GAP, INK, TITLE, draw
from echogrid_training.evaluation.recorded.astyx import Frame, Judge
from echogrid_training.evaluation.recorded.comparison import HalfMaps

DOT = (0, 120, 215)
TITLES = {"analytic": "analytic", "learned": "network, its layer alone", "looks": "network, both layers"}
FRAMES = 3  # of a recording, evenly spread
SURE = 3.0  # log-odds that a label is drawn as
NOWHERE = np.empty((0, 2))


def drive_sheet(halves: HalfMaps) -> Image.Image:
    """The half maps, and on the last one the detections that were left out; y up."""
    where = halves.where
    known = np.any([halves.log_odds[method] != 0 for method in TITLES], axis=0)
    row, rows = _span(known.any(axis=1))
    column, columns = _span(known.any(axis=0))
    origin = ((where.column + column) * where.cell, (where.row + row) * where.cell)
    pictures = [
        (title, draw(halves.log_odds[method][row : row + rows, column : column + columns], origin, where.cell, halves.driven))
        for method, title in TITLES.items()
    ]
    left_out = dotted(pictures[-1][1], (halves.left_out - origin) / where.cell, columns)
    return sheet([*pictures, ("left-out detections", left_out)], across=2)


def frame_sheet(frames: Sequence[Frame], judge: Judge) -> Image.Image:
    """Some frames, a row each: the lidar's labels with the radar's detections, plain Elfes, the network; x to the right, y up."""
    cell, half = judge.spec.cell, judge.spec.half
    pictures = []
    for number in sorted({*np.linspace(0, len(frames) - 1, FRAMES).round().astype(int).tolist()}):
        found = judge(frames[number])
        label = np.where(found.label < 0, 0, SURE * (2 * found.label - 1)).astype(np.float32)
        truth, elfes, learned = (
            draw(plane, (-half, -half), cell, NOWHERE) for plane in (label, found.scores["elfes"], found.scores["learned"])
        )
        places = (judge.base_from_sensor.apply(frames[number].radar) + half) / cell
        pictures += [(f"frame {number}, lidar", dotted(truth, places, judge.spec.cells)), ("elfes", elfes), ("network", learned)]
    return sheet(pictures, across=3)


def sheet(pictures: Sequence[tuple[str, Image.Image]], across: int) -> Image.Image:
    """Pictures of one size with their titles, so many in a row."""
    width, height = pictures[0][1].width + 2 * GAP, pictures[0][1].height + 2 * GAP + TITLE
    out = Image.new("RGB", (across * width, -(-len(pictures) // across) * height), (255, 255, 255))
    pen = ImageDraw.Draw(out)
    for number, (title, picture) in enumerate(pictures):
        left, top = number % across * width + GAP, number // across * height + GAP
        pen.text((left, top), title, fill=INK, font=ImageFont.load_default(size=28))
        out.paste(picture, (left, top + TITLE))
    return out


def dotted(picture: Image.Image, places: Floats, columns: int) -> Image.Image:
    """A map that was drawn with so many columns, dots at places (T, 2) on it: columns and rows from its lower left corner."""
    out = picture.copy()
    pen = ImageDraw.Draw(out)
    zoom = out.width / columns
    for x, y in (places * zoom).tolist():
        pen.rectangle((x, out.height - y - 1, x + 1, out.height - y), fill=DOT)
    return out


def _span(which: np.ndarray) -> tuple[int, int]:
    """The first that holds, and how many there are to the last; all where none does."""
    found = np.flatnonzero(which)
    return (int(found[0]), int(found[-1] - found[0]) + 1) if len(found) else (0, len(which))
