"""A map as ROS map_server keeps it: a yaml file beside a picture.

Pixels become cells as nav2_map_server's map_io makes them since its change to Eigen (commit 8d6948330 of April 2025: Jazzy from 1.3.7 on,
Kilted, Lyrical), in its three modes. A cell (of `nav_msgs/OccupancyGrid`) is 100 * p(occupied), 0 … 100, or -1 for unknown:

    trinary  0, 100 or -1: free, occupied, unknown; all that is left of a probability is on which side of two thresholds it lies
    scale    0 … 100 as grey of 255 levels
    raw      the grey level is the cell, what is above 100 is unknown

In trinary and scale, what is not opaque is unknown.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml as pyyaml
from numpy.typing import NDArray
from PIL import Image

from echogrid.core.map.tiled_map import FREE, OCCUPIED, LogOdds, probability
from echogrid.errors import EchogridError
from echogrid.files import read as read_file
from echogrid.files import whole
from echogrid.maps.dense_map import MOST_CELLS, DenseMap
from echogrid.maps.picture import save

Pixels = NDArray[np.uint8]  # (H, W) grey or (H, W, 4) red, green, blue, alpha; the first row is the largest y
Cells = NDArray[np.int8]  # (H, W); the first row is the smallest y

# Occupied, free; between those of scale, grey is linear.
SUFFIXES = (".yaml", ".yml")
THRESHOLDS = {"trinary": (OCCUPIED, FREE), "scale": (1.0, 0.0), "raw": (OCCUPIED, FREE)}
BLACK, WHITE, GREY = 0, 254, 205  # levels of trinary: occupied, free, unknown
CLAMP = 3.5  # log-odds of what a file calls sure
MOST_YAML = 64 << 10  # bytes
MODES = tuple(THRESHOLDS)
TRUTH = {"y": True, "yes": True, "true": True, "on": True, "n": False, "no": False, "false": False, "off": False}


def picture_path(yaml: Path, mode: str) -> Path:
    """The picture that `write` puts beside a yaml file."""
    return yaml.with_suffix(".png" if mode == "scale" else ".pgm")


def write(yaml: Path, pixels: Pixels, origin: tuple[float, float], cell: float, mode: str) -> None:
    """Pixels as `pixels_of` makes them, the corner (x, y) m of the cell with the smallest of both, and a cell's side m. Raises OSError."""
    picture = picture_path(yaml, mode)
    save(Image.fromarray(pixels), picture, "PPM" if picture.suffix == ".pgm" else "PNG")
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
    grey = np.full(p.shape, GREY, dtype=np.uint8)
    grey[(p >= occupied) & known] = BLACK
    grey[(p <= free) & known] = WHITE
    return grey


def read(yaml: Path) -> DenseMap:
    """The map of a yaml file and its picture; a cell is logit(cell / 100), within +-CLAMP.

    Raises EchogridError for what nav2_map_server would refuse, a rotated origin, a file that is not a picture, and more than MOST_CELLS.
    """
    header = read_header(yaml)
    return DenseMap(log_odds_of(cells_of(*load_picture(header.image), header)), header.origin, header.cell)


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


def cells_of(grey: NDArray[np.uint8], opaque: NDArray[np.bool_], header: Header) -> Cells:
    """(H, W) grey and whether a pixel is opaque, as nav2_map_server reads them; the last row becomes the first."""
    if header.mode == "raw":  # neither `negate` nor alpha says anything here
        return np.where(grey <= 100, grey, -1).astype(np.int8)[::-1]
    # In the precision of Nav2, so that a grey level on a threshold falls to the same side.
    shade = grey.astype(np.float32) / np.float32(255)
    occupied = shade if header.negate else np.float32(1) - shade
    highest, lowest = np.float32(header.occupied), np.float32(header.free)
    cells = np.full(grey.shape, -1.0, dtype=np.float32)
    cells[occupied >= highest] = 100
    cells[occupied <= lowest] = 0  # of one that is both
    if header.mode == "scale":
        between = (occupied > lowest) & (occupied < highest)
        cells[between] = np.floor((occupied[between] - lowest) / (highest - lowest) * np.float32(100) + np.float32(0.5))
    return np.where(opaque, cells, -1).astype(np.int8)[::-1]


def log_odds_of(cells: Cells) -> LogOdds:
    """Within +-CLAMP; 0 for unknown alone, even odds are the smallest positive number."""
    p = np.clip(cells, 0, 100) / 100
    with np.errstate(divide="ignore"):
        log_odds = np.clip(np.log(p) - np.log1p(-p), -CLAMP, CLAMP).astype(np.float32)
    log_odds[log_odds == 0] = np.finfo(np.float32).tiny
    return np.where(cells < 0, np.float32(0), log_odds)


def read_header(yaml: Path) -> Header:
    """Reads the keys of map_server in a yaml file; what else it holds is nobody's. Raises EchogridError."""
    fields = _Fields(yaml, read_file(yaml, MOST_YAML))
    image = fields.text("image")
    origin = fields.numbers("origin")
    if len(origin) != 3:
        raise EchogridError(f"{yaml}: origin: found {len(origin)} numbers, expected three: x, y, yaw")
    if origin[2] != 0:
        raise EchogridError(
            f"{yaml}: origin: found the yaw {origin[2]:g}, expected 0: write 0 there, import the map, rotate it with `echogrid map merge`"
        )
    cell = fields.number("resolution")
    if cell <= 0:
        raise EchogridError(f"{yaml}: resolution: found {cell:g}, expected metres above 0")
    occupied, free = fields.number("occupied_thresh"), fields.number("free_thresh")
    if not 0 <= free <= occupied <= 1:
        raise EchogridError(f"{yaml}: free_thresh, occupied_thresh: found {free:g} and {occupied:g}, expected 0 <= free <= occupied <= 1")
    mode = fields.text("mode", MODES[0]).lower()
    if mode not in MODES:
        raise EchogridError(f"{yaml}: mode: found '{mode[:40]}', expected one of {', '.join(MODES)}")
    return Header(yaml.parent / image, mode, cell, (origin[0], origin[1]), fields.truth("negate"), occupied, free)


class _Fields:
    """The top level of a yaml file, its first document, with the values as they are written."""

    def __init__(self, yaml: Path, data: bytes) -> None:
        self.yaml = yaml
        try:
            loader = pyyaml.BaseLoader(data)
            top = loader.get_node() if loader.check_node() else None
        except RecursionError as error:
            raise EchogridError(f"{yaml}: is no yaml that map_server writes: it is nested too deeply") from error
        except (pyyaml.YAMLError, UnicodeDecodeError) as error:
            raise EchogridError(f"{yaml}: is no yaml: {' '.join(str(error).split())[:200]}") from error
        if not isinstance(top, pyyaml.MappingNode):
            raise EchogridError(f"{yaml}: holds no keys, expected the yaml file of a map_server map")
        self.nodes = top.value

    def text(self, key: str, default: str | None = None) -> str:
        """One word or number."""
        node = self._node(key)
        if node is None and default is not None:
            return default
        if not isinstance(node, pyyaml.ScalarNode) or not node.value:
            raise EchogridError(f"{self.yaml}: the key '{key}' is missing, expected the yaml file of a map_server map")
        return str(node.value)

    def number(self, key: str) -> float:
        """A finite number."""
        return self._finite(key, self.text(key))

    def numbers(self, key: str) -> list[float]:
        """A list of finite numbers."""
        node = self._node(key)
        if not isinstance(node, pyyaml.SequenceNode):
            raise EchogridError(f"{self.yaml}: the key '{key}' is missing, expected a list of numbers")
        return [self._finite(key, item.value if isinstance(item, pyyaml.ScalarNode) else "") for item in node.value]

    def truth(self, key: str) -> bool:
        """A whole number, of which 0 is false, or one of yaml's words."""
        text = self.text(key)
        if re.fullmatch(r"[-+]?\d+", text, re.ASCII):
            return int(text) != 0
        if text not in (text.lower(), text.upper(), text.capitalize()) or text.lower() not in TRUTH:
            raise EchogridError(f"{self.yaml}: {key}: found '{text[:40]}', expected 0 or 1")
        return TRUTH[text.lower()]

    def _node(self, key: str) -> object:
        found = [value for name, value in self.nodes if name.value == key]
        if len(found) > 1:
            raise EchogridError(f"{self.yaml}: the key '{key}' is there {len(found)} times, expected once")
        return found[0] if found else None

    def _finite(self, key: str, text: str) -> float:
        if not re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text, re.ASCII) or not math.isfinite(float(text)):
            raise EchogridError(f"{self.yaml}: {key}: found '{text[:40]}', expected a number")
        return float(text)


def load_picture(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Grey (H, W) of 8 bits as GraphicsMagick makes it of colours and of 16 bits, and whether a pixel is opaque (H, W)."""
    if not path.is_file():
        raise EchogridError(f"{path}: the yaml file names this picture, but it does not exist")
    try:
        with Image.open(path) as picture:
            if picture.width * picture.height > MOST_CELLS:
                raise ValueError(f"it has {picture.width} x {picture.height} pixels, expected at most {MOST_CELLS >> 20} Mi")
            if picture.mode == "I" or picture.mode.startswith("I;16"):
                return _of_16_bits(np.asarray(picture), picture.info.get("transparency"))
            if picture.mode not in ("1", "L", "P", "LA", "PA", "La", "RGB", "RGBA", "RGBX", "RGBa", "CMYK", "YCbCr"):
                raise ValueError(f"its pixels are '{picture.mode}', expected grey or colours of 8 or 16 bits")
            pixels = np.asarray(picture.convert("RGBA"))
    except Exception as error:  # Pillow raises what garbage makes it stumble over
        raise EchogridError(f"{path}: is not a readable picture: {error}") from error
    return luma(pixels[..., :3]), pixels[..., 3] == 255


def luma(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(..., 3) red, green, blue to grey by ITU-R BT.601, rounded in 16 bits and cut to 8, as GraphicsMagick does it."""
    weighted = colours[..., 0] * np.uint32(299) + colours[..., 1] * np.uint32(587) + colours[..., 2] * np.uint32(114)
    grey: NDArray[np.uint8] = ((weighted * np.uint32(257) + np.uint32(500)) // np.uint32(1000) // np.uint32(257)).astype(np.uint8)
    return grey


def _of_16_bits(levels: NDArray[np.generic], transparent: object) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    wide = levels.astype(np.int64)
    if wide.size and not 0 <= int(wide.min()) <= int(wide.max()) < 1 << 16:
        raise ValueError("its grey levels have more than 16 bits")
    return (wide // 257).astype(np.uint8), wide != transparent if isinstance(transparent, int) else np.ones(wide.shape, dtype=np.bool_)
