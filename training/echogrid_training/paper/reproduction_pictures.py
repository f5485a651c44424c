"""The pictures of the reproduction: patches and maps in the paper's colours, free black, unknown grey, occupied white; and curves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter, ImageFont

from echogrid.config.tables import Body
from echogrid.core.evidence.raster import Image as Cells
from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.messages import Floats
from echogrid_training.learning.dataset import SPEC
from echogrid_training.truth.ground_truth import TruthMap, soft

ZOOM = 2  # pixels along a side of a patch's cell
GAP, TITLE = 10, 24  # pixels between pictures of a sheet, and above each
WIDE, HIGH, LEFT, TOP, BOTTOM, RIGHT = 420, 320, 52, 40, 80, 12  # pixels of a chart and of the margins around its lines
LONGEST = 1600  # pixels of a map
TRUTH, WAY, CAR = (240, 140, 20), (40, 150, 220), (40, 190, 110)
PAPER, INK, RULE = (255, 255, 255), (40, 44, 52), (215, 219, 225)
LINES = ((31, 119, 180), (120, 180, 225), (200, 60, 50), (240, 160, 120))  # of a chart
DASHES = 5  # lines between top and bottom of a chart
COVER = 0.6  # of the truth over a map

Pixels = NDArray[np.uint8]


def grey(label: Cells) -> Pixels:
    """-1, surely free, black; 1, surely occupied, white: the paper's [0, 1] -> [black, white] of p(occupied)."""
    return np.rint(255 * (label + 1) / 2).astype(np.uint8)


def ahead_up(patch: Pixels) -> Pixels:
    """A patch (rows y, columns x) turned so that ahead is up and left is left."""
    return np.ascontiguousarray(patch.T[::-1, ::-1])


def patch_picture(label: Cells) -> Image.Image:
    """An answer or a truth (128, 128) in [-1, 1] around the car."""
    return _with_car(Image.fromarray(ahead_up(grey(label))))


def input_picture(image: Cells) -> Image.Image:
    """An image (128, 128) of -1 and 1 that a network is shown; each dot grown to 3 x 3 cells for the eye."""
    dots = Image.fromarray(ahead_up(np.where(image > 0, np.uint8(255), np.uint8(0))))
    return _with_car(dots.filter(ImageFilter.MaxFilter(3)))


def _with_car(cells: Image.Image) -> Image.Image:
    picture = cells.resize((cells.width * ZOOM, cells.height * ZOOM), Image.Resampling.NEAREST).convert("RGB")
    body, scale = Body(), ZOOM / SPEC.cell
    corners = np.array(((body.rear_overhang - body.length, -body.width / 2), (body.rear_overhang, body.width / 2))) * scale
    (front, left), (rear, right) = corners + picture.width / 2
    ImageDraw.Draw(picture).rectangle((left, front, right, rear), outline=CAR)
    return picture


def sheet(rows: Sequence[Sequence[tuple[str, Image.Image]]]) -> Image.Image:
    """Pictures of one size in rows, each under its title."""
    width, height = (size + GAP for size in rows[0][0][1].size)
    whole = Image.new("RGB", (width * max(map(len, rows)) + GAP, (height + TITLE) * len(rows) + GAP), PAPER)
    pen = ImageDraw.Draw(whole)
    for row, pictures in enumerate(rows):
        for column, (title, picture) in enumerate(pictures):
            left, top = GAP + column * width, GAP // 2 + row * (height + TITLE)
            pen.text((left, top), title, fill=INK, font=_font(16))
            whole.paste(picture, (left, top + TITLE))
    return whole


def map_picture(log_odds: LogOdds, over: LogOdds, truth: TruthMap, way: Floats) -> Image.Image:
    """A map on the truth's cells, y up; over it in orange the cells that `over` holds for occupied, and in blue the way (N, 2) m driven."""
    shades = np.repeat(grey(soft(log_odds))[:, :, None], 3, axis=2)
    solid = over > 0
    shades[solid] = np.rint((1 - COVER) * shades[solid] + COVER * np.array(TRUTH)).astype(np.uint8)
    zoom = max(1, min(3, LONGEST // max(log_odds.shape)))
    image = Image.fromarray(shades[::-1]).resize((log_odds.shape[1] * zoom, log_odds.shape[0] * zoom), Image.Resampling.NEAREST)
    pixels = (way - truth.origin) / truth.cell * zoom
    ImageDraw.Draw(image).line([(x, image.height - y) for x, y in pixels.tolist()], fill=WAY, width=zoom)
    return image


def chart(title: str, lines: Mapping[str, Sequence[float]]) -> Image.Image:
    """Up to four lines over epochs 1, 2, …; from 0 up. What is not a number is left out."""
    image = Image.new("RGB", (WIDE, HIGH), PAPER)
    pen, font = ImageDraw.Draw(image), _font(12)
    pen.text((LEFT, 8), title, fill=INK, font=_font(15))
    top = _round_up(max((value for line in lines.values() for value in line if math.isfinite(value)), default=1.0))
    epochs = max(2, *map(len, lines.values()))

    def at(epoch: float, value: float) -> tuple[float, float]:
        across = (epoch - 1) / (epochs - 1)
        return LEFT + across * (WIDE - LEFT - RIGHT), HIGH - BOTTOM - value / top * (HIGH - TOP - BOTTOM)

    for value in np.linspace(0.0, top, DASHES).tolist():
        pen.line((at(1, value), at(epochs, value)), fill=RULE)
        pen.text((LEFT - 6, at(1, value)[1]), f"{value:.3g}", fill=INK, font=font, anchor="rm")
    for epoch in sorted({1, (1 + epochs) // 2, epochs}):
        pen.text((at(epoch, 0)[0], HIGH - BOTTOM + 6), str(epoch), fill=INK, font=font, anchor="ma")
    pen.text((at((1 + epochs) / 2, 0)[0], HIGH - BOTTOM + 22), "epoch", fill=INK, font=font, anchor="ma")
    for number, (colour, (name, line)) in enumerate(zip(LINES, lines.items(), strict=False)):
        points = [at(epoch, value) for epoch, value in enumerate(line, 1) if math.isfinite(value)]
        if len(points) > 1:
            pen.line(points, fill=colour, width=2, joint="curve")
        for x, y in points:
            pen.ellipse((x - 2, y - 2, x + 2, y + 2), fill=colour)
        left, middle = LEFT + number % 2 * (WIDE - LEFT) // 2, HIGH - 30 + number // 2 * 16
        pen.line((left, middle, left + 18, middle), fill=colour, width=3)
        pen.text((left + 24, middle), name, fill=INK, font=font, anchor="lm")
    return image


def _round_up(value: float) -> float:
    """The next of 1, 2, 4, 8 times a power of ten, for the top of an axis."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-9)))
    return next(step * power for step in (1, 2, 4, 8, 10) if value <= step * power)


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)
