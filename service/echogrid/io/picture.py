"""Pictures of maps: log-odds to an image with the driven line and a scale."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from echogrid.core.messages import Floats
from echogrid.core.occupancy import LogOdds, probability

UNKNOWN = (184, 192, 202)
DRIVEN = (226, 88, 34)
INK = (40, 44, 52)
LONGEST = 1600  # pixels


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


def text(log_odds: LogOdds, columns: int) -> str:
    """The map for a terminal, y up, two rows of cells to a line: occupied white, free dark, never seen blank."""
    if not log_odds.size:
        return ""
    step = max(1, -(-log_odds.shape[1] // columns))
    height, width = -(-log_odds.shape[0] // (2 * step)) * 2 * step, -(-log_odds.shape[1] // step) * step
    padded = np.zeros((height, width), dtype=np.float32)
    padded[: log_odds.shape[0], : log_odds.shape[1]] = log_odds
    blocks = padded.reshape(height // step, step, width // step, step)
    highest, lowest = blocks.max(axis=(1, 3)), blocks.min(axis=(1, 3))
    kind = np.where(highest > 1.0, 2, np.where(lowest < -0.5, 1, 0))[::-1]  # 2 occupied, 1 free, 0 never seen
    colour = ("0", "238", "255")
    lines = []
    for upper, lower in zip(kind[::2], kind[1::2], strict=True):
        cells = [f"\x1b[38;5;{colour[u]};48;5;{colour[v]}m▀" for u, v in zip(upper.tolist(), lower.tolist(), strict=True)]
        lines.append("".join(cells) + "\x1b[0m")
    return "\n".join(lines)
