"""Frames: many at once as columns, which is how they are read, received and decoded, and one by one for who asks for that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import cast

import can
import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.can_frames import ERROR as ERROR
from echogrid.core.kernels.can_frames import EXTENDED as EXTENDED
from echogrid.core.kernels.can_frames import FD as FD
from echogrid.core.kernels.can_frames import FIRST_NAME as FIRST_NAME
from echogrid.core.kernels.can_frames import REMOTE as REMOTE
from echogrid.core.kernels.can_frames import SENT as SENT
from echogrid.core.kernels.can_frames import STATE as STATE
from echogrid.core.kernels.can_frames import SWITCH as SWITCH
from echogrid.core.kernels.dispatch import loops

NO_CHANNEL = -1
GROUP = 256  # frames that come one by one


class Frame(msgspec.Struct, eq=False, gc=False):
    """The fields of can.Message with their meaning, without its methods: made in a fifth of the time.

    `dlc` is the number of bytes, whatever code the file has for it; of a remote frame, of those asked for. `channel` is what the file calls
    it: a name, or a number that counts from 1.
    """

    timestamp: float  # s since 1970, or since the recording's begin where it has no date
    arbitration_id: int
    is_extended_id: bool
    is_remote_frame: bool
    is_error_frame: bool
    channel: str | int | None
    dlc: int
    data: bytes
    is_fd: bool = False
    is_rx: bool = True
    bitrate_switch: bool = False
    error_state_indicator: bool = False


AnyFrame = Frame | can.Message


def error_frame(stamp: float, channel: str | int | None, code: int = 0, data: bytes = b"") -> Frame:
    """What a controller says about its bus; its id is a set of flags."""
    return Frame(stamp, code, True, False, True, channel, len(data), data)


@dataclass(frozen=True, slots=True, eq=False)
class FrameBatch:
    """N frames in their order. `channels` are numbers of the recording, NO_CHANNEL, or count from FIRST_NAME down in `names`."""

    stamps: NDArray[np.float64]  # (N,) s
    ids: NDArray[np.uint32]  # (N,)
    flags: NDArray[np.uint8]  # (N,) EXTENDED and the like
    dlc: NDArray[np.uint8]  # (N,) bytes; of a remote frame, those asked for
    sizes: NDArray[np.uint8]  # (N,) bytes that are there
    begins: NDArray[np.int64]  # (N,) where they begin in `data`
    data: NDArray[np.uint8]  # (M,)
    channels: NDArray[np.int32]  # (N,)
    names: tuple[str, ...] = ()

    @classmethod
    def of(cls, frames: Sequence[AnyFrame]) -> FrameBatch:
        """The same frames, of ids and lengths that frames can have."""
        names = dict[str, int]()
        payloads = [bytes(frame.data) for frame in frames]
        lengths = list(map(len, payloads))
        codes, dlc = [frame.arbitration_id for frame in frames], [frame.dlc for frame in frames]
        return cls(
            np.array([frame.timestamp for frame in frames], np.float64),
            np.array(codes, np.uint32),
            np.array([flags_of(frame) for frame in frames], np.uint8),
            np.array(dlc, np.uint8),
            np.array(lengths, np.uint8),
            np.array([*accumulate(lengths, initial=0)][:-1], np.int64),
            np.frombuffer(b"".join(payloads), np.uint8),
            np.array([channel_number(frame.channel, names) for frame in frames], np.int32),
            tuple(names),
        )

    @classmethod
    def joined(cls, batches: Sequence[FrameBatch], *, by_time: bool) -> tuple[FrameBatch, NDArray[np.int64]]:
        """All frames (N,) of several batch by batch, or in the order of their times, and which batch each is of."""
        if not batches:
            batches = (cls.of([]),)
        if len(batches) == 1 and not by_time:
            return batches[0], np.zeros(len(batches[0]), np.int64)
        starts = [*accumulate(map(len, batches), initial=0)]
        bytes_before = [*accumulate((len(batch.data) for batch in batches), initial=0)]
        places, names = dict[tuple[str, ...], int](), list[str]()
        for batch in batches:
            if batch.names not in places:
                places[batch.names] = len(names)
                names.extend(batch.names)
        stamps, count = [batch.stamps for batch in batches], starts.pop()
        order = np.argsort(np.concatenate(stamps), kind="stable") if by_time else np.arange(count)
        flags, dlc, sizes = np.empty((3, count), np.uint8)
        columns = (np.empty(count), np.empty(count, np.uint32), flags, dlc, sizes, np.empty(count, np.int64))
        channels, which = np.empty(count, np.int32), np.empty(count, np.int64)
        loops.join_frames(
            order,
            np.array(starts),
            np.array([bytes_before[:-1], [-places[batch.names] for batch in batches]]),
            stamps,
            [batch.ids for batch in batches],
            [batch.flags for batch in batches],
            [batch.dlc for batch in batches],
            [batch.sizes for batch in batches],
            [batch.begins for batch in batches],
            [batch.channels for batch in batches],
            *columns,
            channels,
            which,
        )
        return cls(*columns, np.concatenate([batch.data for batch in batches]), channels, tuple(names)), which

    def __len__(self) -> int:
        return len(self.stamps)

    def __iter__(self) -> Iterator[can.Message]:
        """One by one: nobody who takes a can.Message from here asks for more than its fields."""
        data, flags = self.data.tobytes(), self.flags
        payloads = [data[at : at + size] for at, size in zip(self.begins.tolist(), self.sizes.tolist(), strict=True)]
        bits = [(flags & bit != 0).tolist() for bit in (EXTENDED, REMOTE, ERROR, FD, SWITCH, STATE)]
        received = (flags & SENT == 0).tolist()
        channels = [self.channel(number) for number in self.channels.tolist()]
        columns = (self.stamps.tolist(), self.ids.tolist(), *bits[:3], channels, self.dlc.tolist(), payloads, bits[3], received, *bits[4:])
        return cast(Iterator[can.Message], map(Frame, *columns))

    def channel(self, number: int) -> str | int | None:
        """What the file calls a channel."""
        return number if number >= 0 else None if number == NO_CHANNEL else self.names[FIRST_NAME - number]

    def where(self, which: NDArray[np.bool_ | np.int64] | slice) -> FrameBatch:
        """Some of them."""
        return FrameBatch(
            self.stamps[which],
            self.ids[which],
            self.flags[which],
            self.dlc[which],
            self.sizes[which],
            self.begins[which],
            self.data,
            self.channels[which],
            self.names,
        )


def batches(frames: Iterator[AnyFrame]) -> Iterator[FrameBatch]:
    """The same frames, GROUP at a time; where an error ends them, those before it are given first."""
    group: list[AnyFrame] = []
    try:
        for frame in frames:
            group.append(frame)
            if len(group) == GROUP:
                yield FrameBatch.of(group)
                group = []
    except GeneratorExit:
        raise
    except Exception:  # of the caller's, who says the rest
        yield FrameBatch.of(group)
        raise
    yield FrameBatch.of(group)


def flags_of(frame: AnyFrame) -> int:
    """All that is yes or no of a frame."""
    return (
        EXTENDED * bool(frame.is_extended_id)
        | REMOTE * bool(frame.is_remote_frame)
        | ERROR * bool(frame.is_error_frame)
        | FD * bool(frame.is_fd)
        | SENT * (not frame.is_rx)
        | SWITCH * bool(frame.bitrate_switch)
        | STATE * bool(frame.error_state_indicator)
    )


def channel_number(channel: object, names: dict[str, int]) -> int:
    """As in a batch's channels; a new name is added to `names`, which have their number. Raises ValueError for a number that is none."""
    if channel is None:
        return NO_CHANNEL
    if not isinstance(channel, int):
        return FIRST_NAME - names.setdefault(str(channel), len(names))
    if not 0 <= channel < 1 << 31:
        raise ValueError(f"the next message's channel is {channel}")
    return channel
