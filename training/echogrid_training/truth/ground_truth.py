"""The true occupancy map: what an ideal lidar says along the true path, summed as log-odds (the paper's Eq. 1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.sensors.lidar import AZIMUTHS, bearings

HIT, PASS, CLAMP = 2.0, -0.5, 6.0  # log-odds of one turn, and what the sum is kept within
REACH = 30.0  # m around the lidar that one turn tells about


@dataclass(frozen=True, slots=True, eq=False)
class TruthMap:
    """Log-odds of occupancy in the frame of the truth's poses: cell [i, j] covers y from origin[1] + i * cell, x from origin[0] + j * cell.

    0 means never seen; a cell whose evidence cancels exactly is kept as the smallest positive number.
    """

    log_odds: LogOdds  # (H, W)
    origin: tuple[float, float]  # m, of the outer corner of cell [0, 0]; a multiple of `cell`
    cell: float  # m

    @property
    def observed(self) -> NDArray[np.bool_]:
        """(H, W) cells about which there is evidence."""
        seen: NDArray[np.bool_] = self.log_odds != 0
        return seen

    def patch(self, pose: SE2, spec: GridSpec) -> Image:
        """(cells, cells) log-odds around a pose of base: every cell of the patch reads the map's cell in which its centre lies."""
        return self.at(pose.apply(spec.centres().reshape(-1, 2))).reshape(spec.cells, spec.cells)

    def at(self, places: Floats) -> LogOdds:
        """(N,) log-odds of the cells in which places (N, 2) m lie; 0 outside the map."""
        cell = np.floor((places - self.origin) / self.cell).astype(np.int64)
        inside = ((cell >= 0) & (cell < self.log_odds.shape[::-1])).all(axis=1)
        out = np.zeros(len(cell), dtype=np.float32)
        out[inside] = self.log_odds[cell[inside, 1], cell[inside, 0]]
        return out


def ternary(log_odds: Image) -> NDArray[np.int8]:
    """-1 free, 0 unknown, 1 occupied."""
    return np.sign(log_odds).astype(np.int8)


def soft(log_odds: Image) -> Image:
    """tanh(L / 2): from -1, surely free, over 0, unknown, to 1, surely occupied."""
    label: Image = np.tanh(0.5 * log_odds)
    return label


class TruthBuilder:
    """Sums turns into one array over a rectangle, which it changes in place."""

    def __init__(self, low: Floats, high: Floats, cell: float = GridSpec().cell) -> None:
        """`low`, `high` (2,) m: the rectangle that holds all places of the lidar."""
        self.cell = cell
        self.first = np.floor((low - REACH) / cell).astype(int) - 1  # column, row of cell [0, 0]
        size = np.ceil((high + REACH) / cell).astype(int) + 1 - self.first
        self.log_odds: LogOdds = np.zeros((size[1], size[0]), dtype=np.float32)

    def add(self, origin: Floats, ranges: Floats, excluded: NDArray[np.bool_]) -> None:
        """One reduced turn from `origin` (2,) m: ranges (AZIMUTHS,) m; those of `excluded` end at movers, which leave nothing."""
        reach = int(REACH / self.cell)
        centre = np.floor(origin / self.cell).astype(int) - self.first
        window = self.log_odds[centre[1] - reach : centre[1] + reach + 1, centre[0] - reach : centre[0] + reach + 1]
        corner = (centre + self.first - reach) * self.cell - origin  # m, of the window's first cell
        added = self.look(corner, 2 * reach + 1, ranges, excluded)
        total = np.clip(window + added, -CLAMP, CLAMP)
        window[:] = np.where((added != 0) & (total == 0), np.finfo(np.float32).tiny, total)

    def look(self, corner: Floats, cells: int, ranges: Floats, excluded: NDArray[np.bool_]) -> Image:
        """(cells, cells) log-odds by one turn, the ideal inverse sensor model: free up to the surface, occupied on it. `corner` (2,) m.

        A cell is free if its centre lies before the surface along its own ray and the two beside it: a wall seen under a flat angle
        has points only every few cells, and the cells between them are no free space.
        """
        axis = (np.arange(cells) + 0.5) * self.cell
        x, y = axis + corner[0], axis + corner[1]
        distance = np.hypot(x, y[:, None])
        ray = np.round(np.arctan2(y[:, None], x) * (AZIMUTHS / (2 * np.pi))).astype(np.intp) % AZIMUTHS
        known = np.where(np.isfinite(ranges), ranges, REACH)  # without one the ground is all there is: rings of it are seen that far
        before = np.minimum(known, np.minimum(np.roll(known, 1), np.roll(known, -1))) - self.cell / 2
        out = np.where((distance < before[ray]) & (distance < REACH), np.float32(PASS), np.float32(0.0))
        bearing = bearings()
        hits = np.isfinite(ranges) & ~excluded & (ranges < REACH)
        column = np.floor((ranges[hits] * np.cos(bearing[hits]) - corner[0]) / self.cell).astype(np.intp)
        row = np.floor((ranges[hits] * np.sin(bearing[hits]) - corner[1]) / self.cell).astype(np.intp)
        inside = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
        out[row[inside], column[inside]] = HIT
        return out

    def finish(self) -> TruthMap:
        """The map without empty borders."""
        rows, columns = (np.flatnonzero(self.log_odds.any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return TruthMap(self.log_odds[:0, :0], (0.0, 0.0), self.cell)
        cut = self.log_odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        origin = (float((self.first[0] + columns[0]) * self.cell), float((self.first[1] + rows[0]) * self.cell))
        return TruthMap(np.ascontiguousarray(cut), origin, self.cell)
