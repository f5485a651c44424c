"""A map as ROS map_server keeps it: a yaml file beside a picture.

Pixels become cells as nav2_map_server's map_io makes them, in its three modes. A cell (of `nav_msgs/OccupancyGrid`) is 100 * p(occupied),
0 … 100, or -1 for unknown:

    trinary  0, 100 or -1: free, occupied, unknown; of a probability only its side of two thresholds is left
    scale    0 … 100 as grey of 255 levels; unknown is what is not opaque, so the picture is a PNG
    raw      the grey level is the cell, 255 is unknown
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from echogrid.core.map.tiled_map import LogOdds, probability
from echogrid.errors import EchogridError
from echogrid.files import read as read_file
from echogrid.files import whole
from echogrid.maps.dense_map import MOST_CELLS, DenseMap

Pixels = NDArray[np.uint8]  # (H, W) grey or (H, W, 4) red, green, blue, alpha; the first row is the largest y
Cells = NDArray[np.int8]  # (H, W); the first row is the smallest y

THRESHOLDS = {"trinary": (0.65, 0.196), "scale": (1.0, 0.0), "raw": (0.65, 0.196)}  # occupied, free; between those of scale, grey is linear
OCCUPIED, FREE, UNKNOWN = 0, 254, 205  # grey levels of trinary
CLAMP = 3.5  # log-odds of what a file calls sure
MOST_YAML = 64 << 10  # bytes
MODES = tuple(THRESHOLDS)


def picture_path(yaml: Path, mode: str) -> Path:
    """The picture that `write` puts beside a yaml file."""
    return yaml.with_suffix(".png" if mode == "scale" else ".pgm")


def write(yaml: Path, pixels: Pixels, origin: tuple[float, float], cell: float, mode: str) -> None:
    """Pixels as `pixels_of` makes them, the corner (x, y) m of the cell with the smallest of both, and a cell's side m. Raises OSError."""
    picture = picture_path(yaml, mode)
    with whole(picture) as partial:
        Image.fromarray(pixels).save(partial, format="PPM" if picture.suffix == ".pgm" else "PNG")
    occupied, free = THRESHOLDS[mode]
    with whole(yaml) as partial:
        partial.write_text(
            f"image: {picture.name}\nmode: {mode}\nresolution: {cell}\norigin: [{origin[0]}, {origin[1]}, 0.0]\nnegate: 0\n"
            f"occupied_thresh: {occupied}\nfree_thresh: {free}\n"
        )


def pixels_of(log_odds: LogOdds, mode: str) -> Pixels:
    """(H, W) log-odds, 0 unknown, as grey (H, W), in mode scale as colours with alpha (H, W, 4); the last row becomes the first."""
    upside_down = log_odds[::-1]
    p, known = probability(upside_down), upside_down != 0
    if mode == "raw":
        return np.where(known, np.rint(100 * p), 255).astype(np.uint8)
    if mode == "scale":
        # Four channels: nav2's map_io warns that its GraphicsMagick loses the alpha of two.
        grey = np.where(known, np.rint(255 * (1 - p)), 128).astype(np.uint8)
        return np.stack((grey, grey, grey, np.where(known, 255, 0).astype(np.uint8)), axis=-1)
    occupied, free = THRESHOLDS[mode]
    grey = np.full(p.shape, UNKNOWN, dtype=np.uint8)
    grey[(p > occupied) & known] = OCCUPIED
    grey[(p < free) & known] = FREE
    return grey


def read(yaml: Path) -> DenseMap:
    """The map of a yaml file and its picture; a cell is logit(cell / 100), within +-CLAMP.

    Raises EchogridError for what nav2_map_server would refuse, a rotated origin, a file that is not a picture, and more than MOST_CELLS.
    """
    header = read_header(yaml)
    pixels, alpha = load_picture(header.image)
    return DenseMap(log_odds_of(cells_of(pixels, alpha, header)), header.origin, header.cell)


@dataclass(frozen=True, slots=True)
class Header:
    """What the yaml file says; `origin` m, `cell` m."""

    image: Path
    mode: str
    cell: float
    origin: tuple[float, float]
    negate: bool
    occupied: float
    free: float


def cells_of(pixels: NDArray[np.uint8], alpha: bool, header: Header) -> Cells:
    """(H, W, C) colours, the last one alpha where there is one, as nav2_map_server reads them; the last row becomes the first."""
    colours = pixels[..., :-1] if alpha else pixels
    # In mode trinary alpha counts as one more colour.
    shade = (pixels if alpha and header.mode == "trinary" else colours).mean(axis=-1, dtype=np.float64) / 255
    if header.mode == "raw":
        level = np.rint(shade * 255)  # `negate` says nothing here
        return np.where(level <= 100, level, -1).astype(np.int8)[::-1]
    occupied = shade if header.negate else 1 - shade
    if header.mode == "scale":
        cells = np.rint((occupied - header.free) / (header.occupied - header.free) * 100)
        unknown = pixels[..., -1] != 255 if alpha else np.zeros(shade.shape, dtype=bool)
    else:
        cells = np.full(shade.shape, -1.0)
        unknown = np.zeros(shade.shape, dtype=bool)
    cells = np.where(occupied > header.occupied, 100, np.where(occupied < header.free, 0, cells))
    return np.where(unknown, -1, cells).astype(np.int8)[::-1]


def log_odds_of(cells: Cells) -> LogOdds:
    """Within +-CLAMP; 0 for unknown alone, even odds are the smallest positive number."""
    p = np.clip(cells, 0, 100) / 100
    with np.errstate(divide="ignore"):
        log_odds = np.clip(np.log(p) - np.log1p(-p), -CLAMP, CLAMP).astype(np.float32)
    log_odds[log_odds == 0] = np.finfo(np.float32).tiny
    return np.where(cells < 0, np.float32(0), log_odds)


def read_header(yaml: Path) -> Header:
    """Reads the yaml that map_server and its savers write: `key: value` lines, a list in brackets or one item a line."""
    try:
        text = read_file(yaml, MOST_YAML).decode()
    except UnicodeDecodeError as error:
        raise EchogridError(f"{yaml}: is not a text file (byte {error.start} is not UTF-8)") from error
    fields = _fields(yaml, text)
    for key in ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh"):
        if key not in fields:
            raise EchogridError(f"{yaml}: the key '{key}' is missing, expected the yaml file of a map_server map")
    mode = fields.get("mode", "trinary")
    if mode not in MODES:
        raise EchogridError(f"{yaml}: mode: found '{mode}', expected one of {', '.join(MODES)}")
    origin = [_number(yaml, "origin", item) for item in fields["origin"].strip("[]").split(",")]
    if len(origin) != 3:
        raise EchogridError(f"{yaml}: origin: found {len(origin)} numbers, expected three: x, y, yaw")
    if origin[2] != 0:
        raise EchogridError(
            f"{yaml}: origin: found the yaw {origin[2]:g}, expected 0: write 0 there, import the map, rotate it with `echogrid map merge`"
        )
    cell, occupied, free = (_number(yaml, key, fields[key]) for key in ("resolution", "occupied_thresh", "free_thresh"))
    if cell <= 0:
        raise EchogridError(f"{yaml}: resolution: found {cell:g}, expected metres above 0")
    if not 0 <= free < occupied <= 1:
        raise EchogridError(f"{yaml}: free_thresh, occupied_thresh: found {free:g} and {occupied:g}, expected 0 <= free < occupied <= 1")
    truth = {"0": False, "1": True, "false": False, "true": True}
    negate = fields["negate"].lower()
    if negate not in truth:
        raise EchogridError(f"{yaml}: negate: found '{negate}', expected 0 or 1")
    return Header(yaml.parent / fields["image"], mode, cell, (origin[0], origin[1]), truth[negate], occupied, free)


def _fields(yaml: Path, text: str) -> dict[str, str]:
    fields: dict[str, str] = {}
    key = ""
    for number, line in enumerate(text.splitlines(), start=1):
        line = re.sub(r"(^|\s)#.*", "", line).rstrip()
        item = re.fullmatch(r"\s*-\s+(.*)", line)
        if item and key and not fields[key].endswith("]"):
            fields[key] = f"{fields[key]},{item[1]}".lstrip(",")
            continue
        pair = re.fullmatch(r"(\w+)\s*:(?:\s+(.*))?", line)
        if pair:
            key = pair[1]
            fields[key] = (pair[2] or "").strip().strip("'\"")
        elif line not in ("", "---", "..."):
            raise EchogridError(f"{yaml}: line {number}: found '{line[:40]}', expected 'key: value' as map_server writes it")
    return fields


def _number(yaml: Path, key: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise EchogridError(f"{yaml}: {key}: found '{text.strip()}', expected a number")
    return number


def load_picture(path: Path) -> tuple[NDArray[np.uint8], bool]:
    """Colours (H, W, C) of 8 bits, and whether the last is alpha."""
    if not path.is_file():
        raise EchogridError(f"{path}: the yaml file names this picture, but it does not exist")
    try:
        with Image.open(path) as picture:
            if picture.width * picture.height > MOST_CELLS:
                raise ValueError(f"it has {picture.width} x {picture.height} pixels, expected at most {MOST_CELLS >> 20} Mi")
            if picture.mode not in ("1", "L", "P", "LA", "RGB", "RGBA"):
                raise ValueError(f"its pixels are '{picture.mode}', expected grey or colours of 8 bits")
            alpha = picture.mode in ("LA", "RGBA") or "transparency" in picture.info
            pixels = np.asarray(picture.convert("RGBA" if alpha else "L" if picture.mode in ("1", "L") else "RGB"))
    except Exception as error:  # Pillow raises what garbage makes it stumble over
        raise EchogridError(f"{path}: is not a readable picture: {error}") from error
    return pixels.reshape(*pixels.shape[:2], -1), alpha
