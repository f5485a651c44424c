"""The hot loops in numpy: what compiled.c does is what these do, bit for bit, and the tests hold it to that.

All of them write into arrays of the caller's. Points are (N, 2), x and y in m; a patch is a square of cells around base, row i along y and
column j along x (`evidence.raster.GridSpec`): `half` is the metres from its middle to an edge, `cell` a cell's side. Only sums, products,
quotients, roots and comparisons are made here, whose bits are the same on every processor; sines and the like come in as arguments, but
those of a few poses, which are the C library's in Python as in C.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.answers import fold as fold
from echogrid.core.kernels.answers import odds as odds
from echogrid.core.kernels.can_frames import can_frames as can_frames
from echogrid.core.kernels.can_frames import join_frames as join_frames
from echogrid.core.kernels.cells import (
    HIT,
    OWN,
    PASSED,
    Bits,
    Bytes,
    Floats,
    Integers,
    Mask,
    Places,
    Singles,
    by_tile,
    byte_of_rcs,
    count,
    largest,
    once,
    patch_cells,
    spread,
    window_cells,
)
from echogrid.core.kernels.frames import quantities as quantities
from echogrid.core.kernels.frames import signals as signals
from echogrid.core.kernels.identify import identify as identify
from echogrid.core.kernels.lines import asc_lines as asc_lines
from echogrid.core.kernels.lines import blf_objects as blf_objects
from echogrid.core.kernels.lines import candump_lines as candump_lines
from echogrid.core.kernels.lines import csv_lines as csv_lines
from echogrid.core.kernels.lines import trc_lines as trc_lines
from echogrid.core.kernels.reading import differing as differing
from echogrid.core.kernels.reading import percent as percent
from echogrid.core.kernels.reading import read_out as read_out
from echogrid.core.kernels.scans import assemble as assemble
from echogrid.core.kernels.sweeps import common_motion as common_motion
from echogrid.core.kernels.sweeps import deviations as deviations
from echogrid.core.kernels.sweeps import gated as gated
from echogrid.core.kernels.sweeps import gathered as gathered
from echogrid.core.kernels.sweeps import leanings as leanings
from echogrid.core.kernels.sweeps import nearby as nearby
from echogrid.core.kernels.sweeps import placed as placed
from echogrid.core.kernels.sweeps import possible as possible
from echogrid.core.kernels.sweeps import recalled as recalled
from echogrid.core.kernels.sweeps import sensors as sensors
from echogrid.core.kernels.sweeps import standing as standing
from echogrid.core.kernels.tiles import add_clamped as add_clamped
from echogrid.core.kernels.tiles import add_looks as add_looks
from echogrid.core.kernels.tiles import add_measured as add_measured
from echogrid.core.kernels.tiles import bilinear as bilinear
from echogrid.core.kernels.tiles import note_views as note_views


def moved(points: Floats, x: float, y: float, cos: float, sin: float, out: Floats) -> None:
    """Points (N, 2) turned by the angle with that cosine and sine, then shifted by (x, y)."""
    there = cos * points[:, 0] - sin * points[:, 1] + x
    out[:, 1] = sin * points[:, 0] + cos * points[:, 1] + y
    out[:, 0] = there


def draw_now(points: Floats, rcs: Floats, deviation: Floats, half: float, cell: float, table: Bytes, out: Bytes) -> None:
    """(3, H, W): how many of the points a cell has as `table` (256,) has it, the strongest (dBsm, NaN unknown), the least deviation."""
    cells = patch_cells(points, half, cell, out.shape[1])
    out[0] = count(cells, table, out[0].shape)
    out[1] = largest(cells, byte_of_rcs(rcs), out[1].shape)
    out[2] = largest(cells, np.clip(255 - 60 * deviation, 1, 255).astype(np.uint8), out[2].shape)


def draw_past(
    points: Floats,
    age: Floats,
    update: Integers,
    rcs: Floats,
    half: float,
    cell: float,
    close: float,
    middle: float,
    fading: float,
    table: Bytes,
    out: Bytes,
) -> None:
    """(6, H, W): how many points up to `close` m and `middle` m old (age (N,)), how many in all, and updates (N,), in rising order, with
    one; 255 less `fading` for each metre of the newest one's age; the strongest."""
    cells, shape = patch_cells(points, half, cell, out.shape[1]), out[0].shape
    out[0] = count(cells[age <= close], table, shape)
    out[1] = count(cells[age <= middle], table, shape)
    out[2] = count(cells, table, shape)
    inside, size = cells >= 0, out[0].size
    out[3] = count(once(update[inside] * size + cells[inside]) % size, table, shape)
    out[4] = largest(cells, np.clip(255 - age * fading, 1, 255).astype(np.uint8), shape)
    out[5] = largest(cells, byte_of_rcs(rcs), shape)


def draw_passes(
    origins: Singles, way: Singles, distance: Singles, half: float, step: float, margin: float, along: int, table: Bytes, out: Bytes
) -> None:
    """(H, W): how many rays pass each block of `along` cells (`step` m), all of its cells alike. Rays from origins (N, 2) over way (N, 2),
    `distance` (N,) m long, asked every `step` m up to `margin` m before their end."""
    blocks = len(out) // along
    reached = np.arange(0.5, distance.max(initial=0.0) / step, dtype=np.float32) * np.float32(step)  # (K,) m
    steps = np.searchsorted(reached, distance - margin)  # (N,) points of each ray
    which = np.arange(steps.sum()) - np.repeat(np.cumsum(steps) - steps, steps)  # (M,) of its ray's points, for all points
    share = reached[which] / np.repeat(np.maximum(distance, np.float32(1e-3)), steps)
    points = np.repeat(origins, steps, axis=0) + share[:, None] * np.repeat(way, steps, axis=0)
    spread(count(patch_cells(points, half, step, blocks), table, (blocks, blocks)), along, out)


def draw_looks(scans: Singles, middle: Singles, table: Bytes, out: Bytes) -> None:
    """(H, W): how many scans (S, 6) had each block in view by its centre, all of its cells alike. A scan: x, y, cosine and sine of its yaw,
    range, cosine of half its field of view. `middle` (blocks,): m, of a column's or a row's centre."""
    blocks, together = len(middle), 16  # at once: what is worked on stays in the processor's cache
    counts = np.zeros((blocks, blocks), dtype=np.int64)
    for start in range(0, len(scans), together):
        x, y, cos, sin, reach, least = scans[start : start + together].T[..., None]
        dx, dy = middle - x, middle - y
        distance = np.sqrt((dx * dx)[:, None, :] + (dy * dy)[:, :, None])
        seen = distance <= reach[..., None]
        seen &= (dx * cos)[:, None, :] + (dy * sin)[:, :, None] >= distance * least[..., None]
        counts += seen.sum(axis=0)
    spread(table[np.minimum(counts, 255)], len(out) // blocks, out)


def elfes(
    origins: Floats,
    distances: Floats,
    rays: Floats,
    weights: Floats,
    half: float,
    cell: float,
    free: float,
    occupied: float,
    margin: float,
    out: Singles,
) -> None:
    """(H, W) log-odds: sum of what detections say that are `distances` (D,) m from origins (D, 2) along rays (D, R, 2), which share each
    by weights (R,): `free` for cells that a ray passes up to `margin` m before its end, `occupied` where it ends."""
    side, size, step = len(out), out.size, cell / 2
    steps = np.maximum(np.ceil((distances - margin - step) / step), 0).astype(np.int64)  # (D,) on each ray
    along = step + np.arange(steps.max(initial=0)) * step  # (K,) m
    passed = patch_cells(origins[:, None, None] + along[:, None] * rays[:, :, None], half, cell, side)  # (D, R, K)
    passed[np.broadcast_to((np.arange(len(along)) >= steps[:, None])[:, None], passed.shape)] = -1
    first = passed >= 0
    first[..., 1:] &= passed[..., 1:] != passed[..., :-1]  # a ray passes a cell once
    ends = patch_cells(origins[:, None] + distances[:, None, None] * rays, half, cell, side)  # (D, R)
    by, ray, _ = np.nonzero(first)
    ended_by, end = np.nonzero(ends >= 0)
    keys = np.concatenate((by * size + passed[first], ended_by * size + ends[ends >= 0]))
    touched, place = np.unique(keys, return_inverse=True)
    said = np.bincount(place, weights=np.concatenate((free * weights[ray], occupied * weights[end]))).astype(np.float32)
    out[:] = np.bincount(touched % size, weights=said, minlength=size).reshape(out.shape)


def look(
    row: int,
    column: int,
    size: int,
    cell: float,
    cos: Floats,
    sin: Floats,
    shares: Floats,
    points: Floats,
    origins: Floats,
    distance: Floats,
    radars: Bits,
    margin: float,
    offsets: Integers,
    weights: Floats,
    hit: Singles,
    marks: Bytes,
    numbers: NDArray[np.uint32],
    touched: Bytes,
    begins: Integers,
    inside: Places,
    hits: Singles,
    near: Singles,
    passes: Singles,
    who: Bits,
) -> None:
    """What beams add to a look in a window of size x size map cells from (row, column) on.

    Beams: points (N, 2) seen from origins (N, 2), `distance` (N,) m away, by `radars` (N,) bits; they may end as far away along rays of
    that `cos` and `sin` (N, R), with shares (R,). A cell around a point's, `offsets` (K,) flat cells from it, is near it by weights (K,).

    The look so far, flat cells, changed: `marks` OWN where a point was, PASSED where a beam passed and HIT where one may have ended, there
    `hit` the largest share. For the compiled loop `numbers` of cells, 0 before and after, and room for those `touched` (cells, 32).

    Out, tile by tile: `begins` (T + 1,) where each tile's cells begin in the rest, rows of tiles first. Of cells that a beam touched:
    `inside` the flat cell in its tile, what is to be added to hits, near and passes, and `who` touched it. Their order within a tile is
    free; arrays are as long as the window has cells.
    """
    ends = np.stack((cos, sin), axis=-1) * distance[:, None, None] + origins[:, None]
    direction = (points - origins) / np.maximum(distance, 1e-9)[:, None]
    flat = window_cells(ends.reshape(-1, 2), row, column, size, cell)
    in_window = flat >= 0
    found, place = np.unique(flat[in_window], return_inverse=True)
    share = np.zeros(size * size, np.float32)
    share[found] = np.minimum(np.bincount(place, weights=np.tile(shares, len(points))[in_window]), 1.0)
    before = np.where(marks[found] & HIT, hit[found], np.float32(0))
    more = np.zeros(size * size, np.float32)
    more[found] = np.maximum(share[found] - before, 0)
    hit[found] = before + more[found]
    marks[found] |= HIT
    mine = once(window_cells(points, row, column, size, cell))
    mine = mine[mine >= 0]
    mine = mine[marks[mine] & OWN == 0]
    marks[mine] |= OWN
    around = mine[:, None] + offsets
    fits = (around >= 0) & (around < size * size)
    beside = np.bincount(around[fits], weights=np.broadcast_to(weights, around.shape)[fits], minlength=size * size)
    steps = np.arange(cell / 2, distance.max(initial=0.0), cell / 2)
    beam, step = np.nonzero(steps[None, :] < (distance - margin)[:, None])
    through = window_cells(origins[beam] + steps[step, None] * direction[beam], row, column, size, cell)
    beam, through = beam[through >= 0], through[through >= 0]
    fresh = np.zeros(size * size, np.uint8)
    fresh[through] = 1
    fresh &= marks & PASSED == 0
    marks[fresh > 0] |= PASSED
    by = np.zeros(size * size, np.uint16)
    for cells, bits in ((flat[in_window], np.repeat(radars, len(shares))[in_window]), (through, radars[beam])):
        for bit in once(bits):
            by[cells[bits == bit]] |= bit
    changed = np.flatnonzero((by != 0) | (beside > 0) | (share > 0) | (fresh > 0))
    order, inside[: len(changed)] = by_tile(changed, row, column, size, begins)
    changed = changed[order]
    for out, values in ((hits, more), (near, beside), (passes, fresh), (who, by)):
        out[: len(changed)] = values[changed]


def usual(
    hit: Integers,
    here: Integers,
    beside: Integers,
    quick: float,
    slow: float,
    arrives: float,
    before: float,
    stayed: float,
    leaves: float,
    settled: bool,
    recent: Singles,
    known: Singles,
    arrived: Mask,
    left: Mask,
) -> None:
    """Moves means (2, cells) of how often a reflection was `here` and `beside` each cell, offsets (K,) from flat cells `hit` (N,): `recent`
    by `quick`, `known` by `slow`. Then, if it is `settled` what is usual, masks (cells,) of where something has arrived, and has left."""
    near = np.zeros(recent.shape, np.bool_)
    for seen, offsets in zip(near, (here, beside), strict=True):
        around = (hit[:, None] + offsets).reshape(-1)
        seen[around[(around >= 0) & (around < len(seen))]] = True
    recent += (near - recent) * np.float32(quick)
    known += (near - known) * np.float32(slow)
    arrived[:] = left[:] = False
    if settled:
        left[:] = (known[0] > stayed) & (recent[1] < leaves)
        known[:, left] = 0.0
        arrived[:] = near[0] & (recent[0] > arrives) & (known[1] < before * recent[0])
