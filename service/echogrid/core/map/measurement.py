"""What the radars measured of the cells around the car, a look at a time: nothing is counted twice that was seen twice from one place.

Within a look each cell counts once: as passed, if a beam went through it; as hit, by the largest share of a reflection that lay in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.beams import Beams, Window, ends, passed
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.map.standstill import Standstill, disc
from echogrid.core.motion.se2 import SE2

REACH = 40.0  # m from the car; what lies farther is not kept
SLACK = 6.0  # m more on each side: where the radars stand, the way of a look, and how far a reflection counts beside its place
NEAR = ((0.55, 1.0), (1.0, 1.7))  # m and weight: a reflection's place is uncertain by half a metre, and by a metre at times
ARRIVED, GONE = 4.0, 10.0  # looks that count for an arrival, looks that are taken to have passed where something left

Numbers = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Of the cells of a window, each (size, size)."""

    window: Window
    hits: Numbers  # looks to be added in which a reflection lay here
    near: Numbers  # the same for reflections beside it, weighted by distance
    passes: Numbers  # looks to be added in which a beam passed
    arrived: NDArray[np.bool_]  # what had passed here before does not hold any more
    left: NDArray[np.bool_]  # nor what was hit
    radars: NDArray[np.uint16]  # bits of those that touched a cell

    @property
    def touched(self) -> tuple[slice, slice] | None:
        """Rows and columns around all cells that change; None if none does."""
        some = (self.hits > 0) | (self.near > 0) | (self.passes > 0) | self.arrived | self.left
        rows, columns = np.flatnonzero(some.any(axis=1)), np.flatnonzero(some.any(axis=0))
        if not len(rows):
            return None
        return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


class Measurement:
    """Remembers what the running look has counted, and while the car stands what is usual."""

    def __init__(self, cell: float, beam: BeamModel) -> None:
        """`cell`: m."""
        self.beam = beam
        self._cell = cell
        self._size = 2 * math.ceil((REACH + SLACK) / cell)
        inner, outer = (disc(radius / cell, self._size) for radius, _ in NEAR)
        self._offsets = outer
        self._weights = np.where(np.isin(outer, inner), NEAR[0][1] + NEAR[1][1], NEAR[1][1])
        self.begin(SE2(0.0, 0.0, 0.0))

    def begin(self, odom_from_base: SE2) -> None:
        """A new look from here."""
        half, cells = self._size // 2, self._size**2
        row, column = (math.floor(value / self._cell) - half for value in (odom_from_base.y, odom_from_base.x))
        self._window = Window(row, column, self._size, self._cell)
        self._hit = np.zeros(cells, np.float32)
        self._own = np.zeros(cells, np.bool_)
        self._passed = np.zeros(cells, np.bool_)
        self._standstill: Standstill | None = None
        self._arrived = np.zeros(0, np.float32)  # looks that arrivals were given

    def look(self, beams: Beams) -> Change:
        """One of the updates that a look consists of: what it adds to those before."""
        cells, shares, who = ends(beams, self._window, self.beam)
        hit, place = np.unique(cells, return_inverse=True)
        share = np.minimum(np.bincount(place, weights=shares), 1.0).astype(np.float32)
        hits = np.zeros_like(self._hit)
        hits[hit] = np.maximum(share - self._hit[hit], 0)
        self._hit += hits
        own = np.unique(self._window.flat(beams.points))
        fresh = own[own >= 0]
        fresh = fresh[~self._own[fresh]]
        self._own[fresh] = True
        through, by = passed(beams, self._window, self.beam)
        passes = np.zeros_like(self._passed)
        passes[through] = True
        passes &= ~self._passed
        self._passed |= passes
        nothing = np.zeros_like(passes)
        return self._change(hits, fresh, passes, nothing, nothing, ((cells, who), (through, by)))

    def stand(self, beams: Beams, seconds: float) -> Change:
        """An update after those, from the same place: only what arrives and what leaves counts. `seconds` since the last."""
        if self._standstill is None:
            self._standstill = Standstill(self._size, self._cell)
            self._arrived = np.zeros_like(self._hit)
        own = np.unique(self._window.flat(beams.points))
        own = own[own >= 0]
        arrived, left = self._standstill.see(own, seconds)
        cells, shares, who = ends(beams, self._window, self.beam)
        counted = arrived[cells] & (self._arrived[cells] < ARRIVED)
        cells, who = cells[counted], who[counted]
        hits = np.minimum(np.bincount(cells, weights=shares[counted], minlength=len(self._hit)), 1.0).astype(np.float32)
        first = arrived & (self._arrived == 0)
        self._arrived[arrived] += 1.0
        self._arrived[left] = 0.0
        fresh = own[arrived[own] & (self._arrived[own] <= ARRIVED)]
        return self._change(hits, fresh, np.zeros_like(first), first, left, ((cells, who),))

    def _change(
        self,
        hits: Numbers,
        own: NDArray[np.int64],
        passes: NDArray[np.bool_],
        arrived: NDArray[np.bool_],
        left: NDArray[np.bool_],
        touched: tuple[tuple[NDArray[np.int64], NDArray[np.uint16]], ...],
    ) -> Change:
        around = own[:, None] + self._offsets
        inside = (around >= 0) & (around < len(hits))
        weights = np.broadcast_to(self._weights, around.shape)
        near = np.bincount(around[inside], weights=weights[inside], minlength=len(hits)).astype(np.float32)
        radars = np.zeros(len(hits), np.uint16)
        for cells, who in touched:
            for bit in np.unique(who):
                radars[cells[who == bit]] |= bit
        square = (self._size, self._size)
        return Change(
            self._window,
            hits.reshape(square),
            near.reshape(square),
            passes.astype(np.float32).reshape(square),
            arrived.reshape(square),
            left.reshape(square),
            radars.reshape(square),
        )
