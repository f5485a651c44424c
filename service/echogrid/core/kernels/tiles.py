"""The reference's loops into the tiles of a map: a patch around the car, and what was measured.

Several tiles at once: their keys (T, 2), row and column of tiles, and lists of their arrays. Ten numbers say where a patch lies on a
rectangle of the map's cells: the rectangle's first row and column, height and width; a cell's side (m); x and y of the car (m), which is
turned by that cosine and sine; cells from the middle of the patch to its corner with a border of one zero cell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.cells import SIDE, Bits, Integers, Mask, Places, Singles, places

Seconds = NDArray[np.uint32]
Part = tuple[slice, slice]


def bilinear(
    planes: Singles,
    row: int,
    column: int,
    height: int,
    width: int,
    cell: float,
    x: float,
    y: float,
    cos: float,
    sin: float,
    shift: float,
    out: Singles,
) -> None:
    """Planes (P, H, W) of a patch on the cells of the rectangle (P, height, width); 0 outside."""
    flat, fu, fv, outside, across = places(planes.shape[1], row, column, height, width, cell, x, y, cos, sin, shift)
    for plane, values in zip(out, np.pad(planes, ((0, 0), (1, 1), (1, 1))).reshape(len(planes), -1), strict=True):
        below = values[flat] * (1 - fu) + values[flat + 1] * fu
        above = values[flat + across] * (1 - fu) + values[flat + across + 1] * fu
        plane[:] = np.where(outside, np.float32(0), below * (1 - fv) + above * fv)


def note_views(
    bits: Bits,
    row: int,
    column: int,
    height: int,
    width: int,
    cell: float,
    x: float,
    y: float,
    cos: float,
    sin: float,
    shift: float,
    now_s: int,
    keys: Integers,
    radars: Sequence[Bits],
    seen_s: Sequence[Seconds],
) -> None:
    """Adds bits (H, W) of a patch to the tiles' radars, to each cell those of the patch's whose centre is nearest; cells with any were seen
    now."""
    flat, fu, fv, outside, across = places(len(bits), row, column, height, width, cell, x, y, cos, sin, shift)
    seen = np.pad(bits, 1).reshape(-1)[flat + (fu >= 0.5) + np.where(fv >= 0.5, across, 0)]
    seen[outside] = 0
    for (inside, piece), who, when in zip(parts(keys, row, column, height, width), radars, seen_s, strict=True):
        who[inside] |= seen[piece]
        when[inside][seen[piece] != 0] = now_s


def add_looks(
    said: Singles,
    share: float,
    row: int,
    column: int,
    height: int,
    width: int,
    cell: float,
    x: float,
    y: float,
    cos: float,
    sin: float,
    shift: float,
    most: float,
    keys: Integers,
    layers: Sequence[Singles],
) -> None:
    """Adds a patch's log-odds by their weights, said (2, H, W), and the weights, a `share` of both, to the first two layers of tiles, and
    shrinks these where the weight exceeds `most`."""
    log_odds, weight = said
    planes = np.stack((log_odds * weight * np.float32(share), weight * np.float32(share)))
    more = np.empty((2, height, width), np.float32)
    bilinear(planes, row, column, height, width, cell, x, y, cos, sin, shift, more)
    for (inside, piece), (total, weights, *_) in zip(parts(keys, row, column, height, width), layers, strict=True):
        total[inside] += more[0][piece]
        weights[inside] += more[1][piece]
        kept = np.minimum(1.0, most / np.maximum(weights[inside], 1.0))
        total[inside] *= kept
        weights[inside] *= kept


def add_clamped(added: Singles, clamp: float, least: float, layer: Singles) -> None:
    """Adds (H, W) to a layer within +-clamp; where they cancel it keeps `least`, since 0 is for what was never seen."""
    total = np.clip(layer + added, -clamp, clamp)
    layer[:] = np.where((added != 0) & (total == 0), np.float32(least), total)


def add_measured(
    begins: Integers,
    cells: Places,
    hits: Singles,
    near: Singles,
    passes: Singles,
    arrived: Mask,
    left: Mask,
    who: Bits,
    now_s: int,
    gone: float,
    most: float,
    layers: Sequence[Singles],
    radars: Sequence[Bits],
    seen_s: Sequence[Seconds],
) -> None:
    """Adds looks (K,) to the hits, near and passes of different flat cells (K,) of tiles: layers 2 to 4. `begins` (T + 1,): where each
    tile's begin.

    Passes before do not hold where something `arrived`; where it `left` hits do not, and `gone` looks have passed there. What exceeds
    `most` looks fades. Radars `who` are noted in `radars` and `seen_s`.
    """
    for begin, end, numbers, noted, seen in zip(begins[:-1].tolist(), begins[1:].tolist(), layers, radars, seen_s, strict=True):
        some = slice(begin, end)
        here, bits = cells[some], who[some]
        noted.reshape(-1)[here] |= bits
        seen.reshape(-1)[here[bits != 0]] = now_s
        flat = numbers[2:].reshape(3, -1)
        hit, beside, passed = flat[:, here]
        passed[arrived[some]] = 0
        hit[left[some]] = beside[left[some]] = 0
        passed[left[some]] = np.maximum(passed[left[some]], np.float32(gone))
        found = np.stack((hit + hits[some], beside + near[some], passed + passes[some]))
        found *= np.minimum(1.0, most / np.maximum(found[0] + found[2], 1.0))
        flat[:, here] = found


def parts(keys: Integers, row: int, column: int, height: int, width: int) -> Iterator[tuple[Part, Part]]:
    """Of each tile the part under a rectangle of map cells, and the part of the rectangle."""
    for tile_row, tile_column in keys.tolist():
        (i, rows), (j, columns) = overlap(tile_row, row, height), overlap(tile_column, column, width)
        yield (i, j), (rows, columns)


def overlap(tile: int, first: int, length: int) -> tuple[slice, slice]:
    """Along one axis: the slice of the tile and the slice of the rectangle [first, first + length) that cover each other."""
    start, stop = max(tile * SIDE, first), min((tile + 1) * SIDE, first + length)
    return slice(start - tile * SIDE, stop - tile * SIDE), slice(start - first, stop - first)
