"""Who reads which frame, and what of it does not depend on other frames, asked for many at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.can.database import FrameId
from echogrid.can.decode import place_of
from echogrid.can.intake.checks import Sums
from echogrid.can.intake.frames import FrameBatch
from echogrid.can.motion import MotionReader
from echogrid.can.pose import PoseReader
from echogrid.can.radar import RadarReader
from echogrid.core.kernels.dispatch import loops
from echogrid.core.kernels.frames import GREATEST
from echogrid.core.kernels.identify import BUS_BIT, EXTENDED_BIT, Sort
from echogrid.core.kernels.plans import Plans
from echogrid.core.messages import EgoMotion, PoseFix, RadarScan
from echogrid.core.radar.scan import NO_FIELD, Frames, known_row

Reader = RadarReader | MotionReader | PoseReader
Item = RadarScan | EgoMotion | PoseFix
Integers = NDArray[np.int64]
UNKNOWN_BUS = -1
OTHER = int(Sort.OTHER)
NOBODY = (-1, 0, 0, -1, 0)  # a frame of no radar, as `assemble` has it
SAYS_NOTHING = (-1, -1, -1, *NO_FIELD, *NO_FIELD)


# What a frame says by itself: who reads it, by the row in Table.others; when it came; whether it is wrong; of ego motion the speeds of the
# rear wheels and the yaw rate, NaN where not said, and counter and direction of travel.
Said = tuple[int, int, bool, list[float], list[int]]


class Intake(msgspec.Struct, frozen=True, eq=False):
    """A batch and what is known of its frames (N,) before their times are."""

    frames: Frames
    others: list[int]  # the frames (M,) that no radar sent, but somebody reads
    said: list[Said]  # (M,) by them


class Table:
    """Readers by bus and id. `known` (K, 5): what `assemble` must know of each; `others`: who else reads a frame, by its row there."""

    def __init__(self, readers: Mapping[tuple[str, FrameId], Reader], buses: Mapping[str, int]) -> None:
        """`buses`: their numbers."""
        self.radars = list(dict.fromkeys(one for one in readers.values() if isinstance(one, RadarReader)))
        self.others: dict[int, tuple[MotionReader | PoseReader, FrameId]] = {}
        self._unread: list[tuple[int, MotionReader, FrameId]] = []  # motion frames that the loops cannot read
        keys, rows, checks, says = list[int](), list[tuple[int, ...]](), list[tuple[int, ...]](), list[tuple[int, ...]]()
        plans, sums = Plans(), Sums()
        for row, ((bus, frame_id), reader) in enumerate(readers.items()):
            keys.append(buses.get(bus, -2) << BUS_BIT | frame_id[1] << EXTENDED_BIT | frame_id[0])
            if isinstance(reader, RadarReader):
                role = reader.roles[frame_id]
                rows.append(known_row(self.radars.index(reader), role))
                checks.append(sums.add(reader.check(role), role.length))
                says.append(SAYS_NOTHING)
                continue
            self.others[row] = reader, frame_id
            rows.append(NOBODY)
            if isinstance(reader, PoseReader):  # it checks them itself
                checks.append(sums.add(None, 0))
                says.append(SAYS_NOTHING)
                continue
            check, plan = reader.checks[frame_id], reader.plans(frame_id)
            checks.append(sums.add(check.crc, check.length))
            direction = reader.direction if frame_id == reader.direction_id else None
            says.append((check.length, *map(plans.add, plan or (None, None)), *place_of(check.counter), *place_of(direction)))
            if plan is None:
                self._unread.append((row, reader, frame_id))
        order = np.argsort(keys, kind="stable")
        self.known = np.array(rows, np.int64)
        keyed = np.array(keys, np.int64)[order], order.astype(np.int64)
        self._arguments: tuple[Any, ...] = (
            *(*keyed, self.known, np.array(checks, np.int64), sums.tables()),
            *(np.array(says, np.int64), *plans.arrays(), GREATEST),
        )

    def intake(self, batch: FrameBatch, buses: Integers) -> Intake:
        """`buses` (N,): by their numbers, UNKNOWN_BUS for others."""
        size = len(batch)
        received_ns, roles, sorts, wrong = (
            np.empty(size, np.int64),
            np.empty(size, np.int64),
            np.empty(size, np.uint8),
            np.empty(size, np.bool_),
        )
        values, counted = np.empty((size, 3)), np.empty((size, 2), np.int64)
        columns = (batch.stamps, batch.ids, batch.flags, batch.sizes, batch.begins, batch.data, buses)
        written = (received_ns, roles, sorts, wrong, values, counted)
        loops.identify(*(*columns, *self._arguments, *written))
        for row, reader, frame_id in self._unread:
            length = reader.checks[frame_id].length
            places = np.flatnonzero((roles == row) & (batch.sizes >= length))
            values[places] = reader.values(frame_id, batch.data[batch.begins[places, None] + np.arange(length)])
        frames = Frames(received_ns, roles, sorts, wrong, batch.sizes, batch.begins, batch.data)
        others = (sorts & OTHER).nonzero()[0]
        told = (roles, received_ns, wrong, values, counted) if len(others) else ()
        said = (column[others].tolist() for column in told)
        return Intake(frames, others.tolist(), list(zip(*said, strict=True)))
