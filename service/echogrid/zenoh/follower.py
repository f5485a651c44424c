"""The window around the car out of key frames and updates, whatever is lost on the way."""

from __future__ import annotations

from typing import NamedTuple

from echogrid.topics.grids import Grid, GridUpdate


class MapName(NamedTuple):
    """Which map it is: windows of one map share a raster and fit together."""

    source: bytes  # 16, of the run of the service
    epoch: int  # the map's number, which goes up when the car's position was lost


class KeyName(NamedTuple):
    """A key frame."""

    map: MapName
    number: int  # counts on over all maps of a source


class Window(Grid, frozen=True, eq=False):
    """A grid with the name of its map."""

    map: MapName


class Follower:
    """Remembers the key frame and the newest update: together what the map around the car was at the update's stamp."""

    def __init__(self) -> None:
        self._key: tuple[KeyName, Grid] | None = None
        self._update: tuple[KeyName, GridUpdate] | None = None

    def key(self, name: KeyName, grid: Grid) -> None:
        """Takes a key frame, unless it is older than the one that is held. Another source is a service that was restarted."""
        if self._key is not None and _is_older(name, self._key[0]):
            return
        self._key = (name, grid)
        if self._update is not None and (self._update[0].map.source != name.map.source or _is_older(self._update[0], name)):
            self._update = None

    def update(self, name: KeyName, update: GridUpdate) -> None:
        """Takes an update for the key frame of that name, which may have come already, come later or be lost."""
        if self._key is None or not _is_older(name, self._key[0]):
            self._update = (name, update)

    def window(self) -> Window | None:
        """The newest known window, with its stamp; None if the newest update's key frame is missing. Raises ValueError
        for an update that reaches beyond its key frame, once."""
        if self._key is None:
            return None
        name, grid = self._key
        if self._update is None:
            return Window(grid.stamp_ns, grid.frame, grid.cell, grid.origin, grid.occupancy, name.map)
        made_for, update = self._update
        if made_for != name:
            return None
        (height, width), cells = update.occupancy.shape, grid.occupancy.copy()
        if update.x + width > cells.shape[1] or update.y + height > cells.shape[0]:
            self._update = None
            raise ValueError(
                f"an update of {height} x {width} cells from row {update.y} and column {update.x} on reaches beyond its key frame"
            )
        cells[update.y : update.y + height, update.x : update.x + width] = update.occupancy
        return Window(update.stamp_ns, grid.frame, grid.cell, grid.origin, cells, name.map)


def _is_older(name: KeyName, other: KeyName) -> bool:
    return name.map.source == other.map.source and name.number < other.number
