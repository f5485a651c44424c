"""What the radars measured of the cells around the car, a look at a time: nothing is counted twice that was seen twice from one place.

Within a look each cell counts once: as passed, if a beam went through it; as hit, by the largest share of a reflection that lay in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.beams import Beams, Cells, Reach, Window
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.kernels.cells import by_tile, once
from echogrid.core.kernels.dispatch import loops
from echogrid.core.map.standstill import Standstill, disc
from echogrid.core.map.tile import TileKey, tiles_under
from echogrid.core.motion.se2 import SE2

REACH = 40.0  # m from the car; what lies farther is not kept
SLACK = 6.0  # m more on each side: where the radars stand, the way of a look, and how far a reflection counts beside its place
NEAR = ((0.55, 1.0), (1.0, 1.7))  # m and weight: a reflection's place is uncertain by half a metre, and by a metre at times
ARRIVED, GONE = 4.0, 10.0  # looks that count for an arrival, looks that are taken to have passed where something left

Numbers = NDArray[np.float32]


class Change(msgspec.Struct, frozen=True, eq=False):
    """Of the map's cells that an update touched, (K,) each, tile by tile."""

    under: Sequence[TileKey]  # (T,) all tiles under the window, by rows
    begins: Cells  # (T + 1,) where each tile's begin
    inside: NDArray[np.int32]  # flat cell in its tile
    hits: Numbers  # looks to be added in which a reflection lay here
    near: Numbers  # the same for reflections beside it, weighted by distance
    passes: Numbers  # looks to be added in which a beam passed
    arrived: NDArray[np.bool_]  # what had passed here before does not hold any more
    left: NDArray[np.bool_]  # nor what was hit
    radars: NDArray[np.uint16]  # bits of those that touched a cell

    def touched(self) -> tuple[Cells, list[TileKey]]:
        """The tiles with such cells, and where in the arrays each one's begin (T + 1,)."""
        begins = self.begins.tolist()
        some = [n for n, (begin, end) in enumerate(pairwise(begins)) if begin != end]
        return np.array([begins[n] for n in some] + begins[-1:]), [self.under[n] for n in some]


class Measurement:
    """Remembers what the running look has counted, and while the car stands what is usual."""

    def __init__(self, cell: float, beam: BeamModel) -> None:
        """`cell`: m."""
        self.beam = beam
        self._spread = (*beam.spread(), beam.beam_sigma)
        self._cell = cell
        self._size = 2 * math.ceil((REACH + SLACK) / cell)
        inner, outer = (disc(radius / cell, self._size) for radius, _ in NEAR)
        self._offsets = outer
        self._weights = np.where(np.isin(outer, inner), NEAR[0][1] + NEAR[1][1], NEAR[1][1])
        cells = self._size**2
        self._inside = np.empty(cells, np.int32)
        self._hits, self._near, self._passes = (np.empty(cells, np.float32) for _ in range(3))
        self._radars, self._nowhere = np.empty(cells, np.uint16), np.zeros(cells, np.bool_)
        self._hit, self._marks, self._numbers = np.empty(cells, np.float32), np.zeros(cells, np.uint8), np.zeros(cells, np.uint32)
        self._touched = np.empty((cells, 32), np.uint8)  # memory only as far as looks have needed it
        self.begin(SE2(0.0, 0.0, 0.0))

    def begin(self, odom_from_base: SE2) -> None:
        """A new look from here."""
        half = self._size // 2
        row, column = (math.floor(value / self._cell) - half for value in (odom_from_base.y, odom_from_base.x))
        self._window = Window(row, column, self._size, self._cell)
        self._under = tiles_under(row, column, self._size, self._size)
        self._marks.fill(0)
        self._standstill: Standstill | None = None
        self._arrived = np.zeros(0, np.float32)  # looks that arrivals were given

    def look(self, beams: Beams) -> Change:
        """One of the updates that a look consists of: what it adds to those before. The change holds until the next."""
        window, reach = self._window, Reach.of(beams, *self._spread)
        begins = np.empty(len(self._under) + 1, np.int64)
        loops.look(
            window.row,
            window.column,
            window.size,
            window.cell,
            reach.cos,
            reach.sin,
            reach.shares,
            beams.points,
            beams.origins,
            reach.distance,
            beams.radars,
            self.beam.margin * window.cell,
            self._offsets,
            self._weights,
            self._hit,
            self._marks,
            self._numbers,
            self._touched,
            begins,
            self._inside,
            self._hits,
            self._near,
            self._passes,
            self._radars,
        )
        some = slice(begins[-1])
        nothing, hits, near, passes = self._nowhere[some], self._hits[some], self._near[some], self._passes[some]
        return Change(self._under, begins, self._inside[some], hits, near, passes, nothing, nothing, self._radars[some])

    def stand(self, beams: Beams, seconds: float) -> Change:
        """An update after those, from the same place: only what arrives and what leaves counts. `seconds` since the last."""
        if self._standstill is None:
            self._standstill = Standstill(self._size, self._cell)
            self._arrived = np.zeros_like(self._hit)
        window = self._window
        own = window.flat(beams.points)
        own = once(own[own >= 0])
        arrived, left = self._standstill.see(own, seconds)
        if not arrived.any() and not left.any():
            return self._nothing()
        reach = Reach.of(beams, *self._spread)
        cells = window.flat(reach.ends(beams))  # (N, rays)
        counted = (cells >= 0) & arrived[cells] & (self._arrived[cells] < ARRIVED)
        cells, who = cells[counted], np.broadcast_to(beams.radars[:, None], cells.shape)[counted]
        shares = np.broadcast_to(reach.shares, counted.shape)[counted]
        hits = np.minimum(np.bincount(cells, weights=shares, minlength=len(self._hit)), 1.0)
        first = arrived & (self._arrived == 0)
        self._arrived[arrived] += 1.0
        self._arrived[left] = 0.0
        fresh = own[arrived[own] & (self._arrived[own] <= ARRIVED)]
        around = fresh[:, None] + self._offsets
        fits = (around >= 0) & (around < len(hits))
        near = np.bincount(around[fits], weights=np.broadcast_to(self._weights, around.shape)[fits], minlength=len(hits))
        radars = np.zeros(len(hits), np.uint16)
        for bit in once(who):
            radars[cells[who == bit]] |= bit
        touched = np.flatnonzero((hits > 0) | (near > 0) | first | left)
        begins = np.empty(len(self._under) + 1, np.int64)
        order, inside = by_tile(touched, window.row, window.column, window.size, begins)
        some = touched[order]
        hit, beside = (values[some].astype(np.float32) for values in (hits, near))
        return Change(self._under, begins, inside, hit, beside, np.zeros_like(hit), first[some], left[some], radars[some])

    def _nothing(self) -> Change:
        """No cell changes."""
        numbers, flags = np.empty(0, np.float32), np.empty(0, np.bool_)
        begins = np.zeros(len(self._under) + 1, np.int64)
        inside, radars = np.empty(0, np.int32), np.empty(0, np.uint16)
        return Change(self._under, begins, inside, numbers, numbers, numbers, flags, flags, radars)
