"""Who reads which frame, asked for many at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import ERROR, EXTENDED, REMOTE, FrameBatch
from echogrid.can.intake.traffic_time import nanoseconds
from echogrid.can.motion import FrameId, MotionReader, Values
from echogrid.can.pose import PoseReader
from echogrid.can.radar import RadarReader
from echogrid.core.messages import EgoMotion, PoseFix, RadarScan
from echogrid.core.radar.scan import known_row

Reader = RadarReader | MotionReader | PoseReader
Item = RadarScan | EgoMotion | PoseFix
Integers = NDArray[np.int64]
UNKNOWN_BUS = -1
NOBODY = (-1, 0, 0, -1, 0)  # a frame of no radar, as `assemble` has it
_BUS, _EXTENDED = 33, 32  # bits of a key above those of the id


class Table:
    """Readers by bus and id. `known` (K, 5): what `assemble` must know of each; `others`: who else reads a frame, by its row there."""

    def __init__(self, readers: Mapping[tuple[str, FrameId], Reader], buses: Mapping[str, int]) -> None:
        """`buses`: their numbers."""
        self.radars = list(dict.fromkeys(one for one in readers.values() if isinstance(one, RadarReader)))
        self.others: dict[int, tuple[MotionReader | PoseReader, FrameId]] = {}
        keys, rows, self._checked = list[int](), list[tuple[int, ...]](), dict[int, tuple[RadarReader, FrameId]]()
        for row, ((bus, frame_id), reader) in enumerate(readers.items()):
            keys.append(buses.get(bus, -2) << _BUS | frame_id[1] << _EXTENDED | frame_id[0])
            if isinstance(reader, RadarReader):
                rows.append(known_row(self.radars.index(reader), reader.roles[frame_id]))
                if reader.layout.frame_crc is not None:
                    self._checked[row] = reader, frame_id
            else:
                rows.append(NOBODY)
                self.others[row] = reader, frame_id
        self.known = np.array(rows, np.int64).reshape(-1, len(NOBODY))
        order = np.argsort(keys, kind="stable")
        self._keys, self._rows = np.array(keys, np.int64)[order], order.astype(np.int64)

    def roles(self, batch: FrameBatch, buses: Integers) -> Integers:
        """(N,) rows of `known`, -1 where nobody reads a frame."""
        keys = buses << _BUS | (batch.flags & EXTENDED).astype(np.int64) << _EXTENDED | batch.ids
        places = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        return np.where(self._keys[places] == keys, self._rows[places], -1)

    def values(self, batch: FrameBatch, roles: Integers) -> dict[int, Values]:
        """Of frames of ego motion that are long enough, by their place in the batch."""
        found: dict[int, Values] = {}
        for row, (reader, frame_id) in self.others.items():
            if isinstance(reader, PoseReader):
                continue
            length = reader.checks[frame_id].length
            places = np.flatnonzero((roles == row) & (batch.sizes >= length))
            if len(places):
                rows = batch.data[batch.begins[places, None] + np.arange(length)]
                found.update(zip(places.tolist(), reader.values(frame_id, rows), strict=True))
        return found

    def wrong(self, batch: FrameBatch, roles: Integers) -> NDArray[np.bool_]:
        """(N,) where a radar's frame has a checksum of its own and it is wrong."""
        found = np.zeros(len(batch), np.bool_)
        if not self._checked:
            return found
        for at in np.flatnonzero(np.isin(roles, list(self._checked))).tolist():
            reader, frame_id = self._checked[int(roles[at])]
            role, begin = reader.roles[frame_id], int(batch.begins[at])
            if batch.sizes[at] >= role.length:
                found[at] = not reader.holds(role, batch.data[begin : begin + role.length].tobytes())
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Intake:
    """A batch and what is known of its frames (N,) before their times are."""

    batch: FrameBatch
    received_ns: Integers
    counts: NDArray[np.bool_]  # as traffic: no error frame
    unknown: NDArray[np.bool_]  # nobody reads them
    remote: NDArray[np.bool_]  # of ids that are read
    roles: Integers  # of frames with data that are read, else -1
    others: NDArray[np.bool_]  # of them, those of no radar
    wrong: NDArray[np.bool_]
    values: dict[int, Values]

    @classmethod
    def of(cls, batch: FrameBatch, buses: Integers, table: Table) -> Intake:
        """`buses` (N,): by their numbers in the table, UNKNOWN_BUS for others."""
        roles, counts = table.roles(batch, buses), batch.flags & ERROR == 0
        known, remote = roles >= 0, batch.flags & REMOTE != 0
        roles = np.where(counts & ~remote, roles, -1)
        others = (roles >= 0) & (table.known[roles, 0] < 0)
        wrong, values = table.wrong(batch, roles), table.values(batch, roles)
        return cls(batch, nanoseconds(batch.stamps), counts, counts & ~known, counts & known & remote, roles, others, wrong, values)
