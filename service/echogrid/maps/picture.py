"""Pictures of maps: log-odds to an image with the driven line and a scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from echogrid.core.map.tiled_map import LogOdds, probability
from echogrid.core.messages import Floats
from echogrid.files import whole

UNKNOWN = (184, 192, 202)
DRIVEN = (226, 88, 34)
INK = (40, 44, 52)
LONGEST = 1600  # pixels
OCCUPIED = 1.0  # log-odds of what a small picture must not lose
PLAIN = {(True, True): "█", (True, False): "▀", (False, True): "▄"}  # where the upper and the lower cell are occupied
GAP, TITLE = 8, 40  # pixels around a panel and above it


def shade(log_odds: LogOdds) -> NDArray[np.uint8]:
    """(H, W, 3) colours: free white, occupied black, never seen blue-grey. Row 0 stays row 0."""
    grey = np.rint(255 * (1 - probability(log_odds))).astype(np.uint8)
    colours = np.repeat(grey[:, :, None], 3, axis=2)
    colours[log_odds == 0] = UNKNOWN
    return colours


def draw(log_odds: LogOdds, origin: tuple[float, float], cell: float, driven: Floats) -> Image.Image:
    """The map with y up: `origin` is (x, y) of the corner of cell [0, 0], `driven` (N, 2) the line of base, all m in `odom`."""
    zoom = max(1, min(6, LONGEST // max(*log_odds.shape, 1)))
    image = Image.fromarray(shade(log_odds)[::-1]).resize((log_odds.shape[1] * zoom, log_odds.shape[0] * zoom), Image.Resampling.NEAREST)
    pen = ImageDraw.Draw(image)
    pixels = (driven - origin) / cell * zoom
    line = [(x, image.height - y) for x, y in pixels.tolist()]
    if len(line) > 1:
        pen.line(line, fill=DRIVEN, width=2)
        x, y = line[0]
        pen.ellipse((x - 4, y - 4, x + 4, y + 4), fill=DRIVEN)
    bar = 10.0 / cell * zoom
    if bar < image.width - 24:
        left, bottom = 12, image.height - 12
        pen.rectangle((left - 6, bottom - 30, left + bar + 6, bottom + 6), fill=(255, 255, 255))
        pen.rectangle((left, bottom - 4, left + bar, bottom), fill=INK)
        pen.text((left, bottom - 26), "10 m", fill=INK, font=ImageFont.load_default(size=16))
    return image


def save(image: Image.Image, path: Path, form: str = "PNG", compress_level: int = 6) -> None:
    """`form`: of Pillow's names. The file is whole, or not there. Raises OSError.

    Where the disk becomes full Pillow itself leaves a torn PGM without a word (findings/pillow_short_writes.sh).
    """
    packed = BytesIO()
    image.save(packed, format=form, compress_level=compress_level)
    with whole(path) as partial:
        partial.write_bytes(packed.getbuffer())


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """A map with a title; `origin` is (x, y) in m of the corner of cell [0, 0], a multiple of the cell's size."""

    title: str
    log_odds: LogOdds
    origin: tuple[float, float]

    def cut(self, origin: tuple[float, float], shape: tuple[int, ...], cell: float) -> LogOdds:
        """The map on another rectangle of cells; 0 where it has none."""
        out = np.zeros(shape, dtype=np.float32)
        column, row = (round((mine - theirs) / cell) for mine, theirs in zip(self.origin, origin, strict=True))
        height, width = self.log_odds.shape
        top, left = max(row, 0), max(column, 0)
        bottom, right = min(row + height, shape[0]), min(column + width, shape[1])
        if bottom > top and right > left:
            out[top:bottom, left:right] = self.log_odds[top - row : bottom - row, left - column : right - column]
        return out


def side_by_side(panels: Sequence[Panel], cell: float, driven: Floats) -> Image.Image:
    """The panels two in a row, all on the last one's rectangle, y up."""
    last = panels[-1]
    pictures = []
    for panel in panels:
        picture = draw(panel.cut(last.origin, last.log_odds.shape, cell), last.origin, cell, driven)
        framed = Image.new("RGB", (picture.width + 2 * GAP, picture.height + 2 * GAP + TITLE), (255, 255, 255))
        framed.paste(picture, (GAP, GAP + TITLE))
        ImageDraw.Draw(framed).text((GAP, GAP), panel.title, fill=INK, font=ImageFont.load_default(size=28))
        pictures.append(framed)
    width, height = pictures[0].size
    rows = -(-len(pictures) // 2)
    sheet = Image.new("RGB", (2 * width, rows * height), (255, 255, 255))
    for number, picture in enumerate(pictures):
        sheet.paste(picture, (number % 2 * width, number // 2 * height))
    return sheet


def shrink(log_odds: LogOdds, step: int) -> LogOdds:
    """One cell for every step x step, from the first on: what is surely occupied (log-odds above 1) stays, else what is free."""
    height, width = -(-log_odds.shape[0] // step) * step, -(-log_odds.shape[1] // step) * step
    padded = np.zeros((height, width), dtype=np.float32)
    padded[: log_odds.shape[0], : log_odds.shape[1]] = log_odds
    blocks = padded.reshape(height // step, step, width // step, step)
    highest, lowest = blocks.max(axis=(1, 3)), blocks.min(axis=(1, 3))
    return np.asarray(np.where((highest > OCCUPIED) | (lowest == 0), highest, lowest), dtype=np.float32)


def text(log_odds: LogOdds, columns: int, *, coloured: bool = True) -> str:
    """The map for a terminal, y up, two rows of cells to a line: occupied white, free dark, never seen blank.

    Without colours: blocks where occupied, dots where free.
    """
    if not log_odds.size:
        return ""
    step = max(1, -(-log_odds.shape[1] // columns))
    seen = shrink(log_odds, step)
    seen = np.pad(seen, ((0, len(seen) % 2), (0, 0)))
    kind = np.where(seen > OCCUPIED, 2, np.where(seen < -0.5, 1, 0))[::-1]  # 2 occupied, 1 free, 0 never seen
    colour = ("0", "238", "255")
    lines = []
    for upper, lower in zip(kind[::2].tolist(), kind[1::2].tolist(), strict=True):
        pairs = zip(upper, lower, strict=True)
        if coloured:
            lines.append("".join(f"\x1b[38;5;{colour[u]};48;5;{colour[v]}m▀" for u, v in pairs) + "\x1b[0m")
        else:
            lines.append("".join(PLAIN[u == 2, v == 2] if 2 in (u, v) else "·" if 1 in (u, v) else " " for u, v in pairs).rstrip())
    return "\n".join(lines)
