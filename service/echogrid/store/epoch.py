"""One map of a store: what is needed to read its tiles, as it is in the table `epoch`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec

from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import MOST_RADARS
from echogrid.store.store_file import StoreError

Kind = Literal["looks", "sum"]
LAYERS: Mapping[Kind, int] = {"looks": LookMap.layers, "sum": OccupancyMap.layers}


@dataclass(frozen=True, slots=True)
class Description:
    """What has to be known to read an epoch's tiles."""

    begun_ns: int  # Unix time
    vehicle: str
    cell: float  # m
    kind: Kind
    clamp: float  # log-odds
    calibration: Calibration  # of `looks`; as it is by default for `sum`
    radars: tuple[str, ...]  # in the order of the bits of Tile.radars

    @property
    def layers(self) -> int:
        """Of its tiles."""
        return LAYERS[self.kind]


@dataclass(frozen=True, slots=True)
class Epoch:
    """One map of a store."""

    id: int
    description: Description
    tiles: int
    bytes: int  # of its tiles' data
    newest_ns: int | None  # newest stamp of a tile; None if there is none


def row_of(description: Description) -> tuple[Any, ...]:
    """The columns of the table `epoch` behind its number."""
    pair = (description.calibration.learned, description.calibration.offset)
    texts = [msgspec.json.encode(value).decode() for value in (pair, description.radars)]
    return (description.begun_ns, description.vehicle, description.cell, description.kind, description.clamp, *texts)


def description_of(row: tuple[Any, ...], path: Path) -> Description:
    """Out of a row of the table `epoch`, its number first; what follows is not read. Raises StoreError where it is damaged."""
    epoch, begun_ns, vehicle, cell, kind, clamp, calibration, radars = row[:8]
    try:
        a, b = msgspec.json.decode(calibration, type=tuple[float, float])
        names = msgspec.json.decode(radars, type=tuple[str, ...])
    except (msgspec.DecodeError, TypeError) as error:
        raise StoreError(f"{path}: epoch {epoch}: calibration or radars cannot be read: {error}") from error
    sound = (
        kind in LAYERS
        and isinstance(begun_ns, int)
        and isinstance(vehicle, str)
        and all(isinstance(number, float) and 0 < number < 1e6 for number in (cell, clamp))
        and math.isfinite(a)
        and math.isfinite(b)
        and len(names) <= MOST_RADARS
    )
    if not sound:
        raise StoreError(f"{path}: epoch {epoch} is damaged: kind '{kind}', cells of {cell} m, clamp {clamp}, {len(names)} radars")
    return Description(begun_ns, vehicle, cell, kind, clamp, Calibration(a, b), names)
