"""Windows as every method sees them, side by side, and what stated probabilities are worth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from echogrid.core.evidence.raster import Image as Window
from echogrid.maps.picture import DRIVEN, GAP, INK, UNKNOWN, shade
from echogrid_training.evaluation.simulated.judging import Picture

ZOOM, ACROSS, TITLE = 2, 5, 22  # pixels a cell, panels in a row, pixels above a panel
SIDE, MARGIN = 560, 60  # pixels of the reliability plot
COLOURS = ((226, 88, 34), (24, 96, 168), (40, 140, 80), (150, 60, 150), (120, 120, 120), (190, 150, 20), (0, 150, 160), (90, 60, 30))
LEAST = 1e-4  # share of the cells that a point of the plot must stand for


def windows(picture: Picture) -> Image.Image:
    """Truth, detections where they are known, and the methods' calibrated log-odds: white is free, black occupied. x up, y to the left."""
    panels = [("truth", shade(picture.truth))]
    if picture.detections is not None:
        panels.append(("detections: now, 15 m", _detections(*picture.detections)))
    panels += [(name, shade(said.astype(np.float32))) for name, said in picture.said.items()]
    side = panels[0][1].shape[0] * ZOOM
    wide, high = side + GAP, side + GAP + TITLE
    sheet = Image.new("RGB", (GAP + min(len(panels), ACROSS) * wide, GAP + math.ceil(len(panels) / ACROSS) * high), (255, 255, 255))
    pen = ImageDraw.Draw(sheet)
    for index, (title, colours) in enumerate(panels):
        left, top = GAP + index % ACROSS * wide, GAP + index // ACROSS * high
        pen.text((left, top), title, fill=INK, font=ImageFont.load_default(size=14))
        turned = colours.transpose(1, 0, 2)[::-1, ::-1]  # rows are y, columns x; the car looks up
        sheet.paste(Image.fromarray(np.ascontiguousarray(turned)).resize((side, side), Image.Resampling.NEAREST), (left, top + TITLE))
    return sheet


def _detections(now: Window, past: Window) -> np.ndarray:
    colours = np.full((*now.shape, 3), 255, dtype=np.uint8)
    colours[past > 0] = UNKNOWN
    colours[now > 0] = DRIVEN
    return colours


def reliability_plot(rows: dict[str, Any], title: str) -> Image.Image:
    """The share of occupied cells over the probability that was stated, by method: on the diagonal, what is said is true."""
    font = ImageFont.load_default(size=14)
    plot = Image.new("RGB", (SIDE + 2 * MARGIN, SIDE + 2 * MARGIN), (255, 255, 255))
    pen = ImageDraw.Draw(plot)

    def place(stated: float, found: float) -> tuple[float, float]:
        return MARGIN + stated * SIDE, MARGIN + (1 - found) * SIDE

    pen.rectangle((*place(0, 1), *place(1, 0)), outline=INK)
    pen.line((*place(0, 0), *place(1, 1)), fill=UNKNOWN, width=2)
    for tick in np.linspace(0, 1, 6):
        pen.text((place(tick, 0)[0], place(tick, 0)[1] + 6), f"{tick:.1f}", fill=INK, font=font, anchor="ma")
        pen.text((place(0, tick)[0] - 6, place(0, tick)[1]), f"{tick:.1f}", fill=INK, font=font, anchor="rm")
    pen.text((MARGIN, MARGIN / 3), title, fill=INK, font=font)
    pen.text((MARGIN + SIDE / 2, SIDE + 1.6 * MARGIN), "stated probability of occupied", fill=INK, font=font, anchor="mm")
    for index, (name, row) in enumerate(rows.items()):
        cells, stated, found = np.array(row["reliability"])
        some = cells > LEAST * cells.sum()
        points = [place(s / n, f / n) for n, s, f in zip(cells[some], stated[some], found[some], strict=True)]
        colour = COLOURS[index % len(COLOURS)]
        if len(points) > 1:
            pen.line(points, fill=colour, width=2)
        for x, y in points:
            pen.ellipse((x - 3, y - 3, x + 3, y + 3), fill=colour)
        pen.text((MARGIN + 12, MARGIN + 10 + 18 * index), name, fill=colour, font=font)
    return plot
