"""The frames of a recording by channel and id, as many as a survey needs."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from operator import itemgetter

import can

from echogrid.can.database import FrameId

MOST_FRAMES = 300_000  # of each channel that are kept, the first ones; all are counted
ALONE = 3  # frames of an id: fewer are strays


@dataclass(slots=True)
class Channel:
    """One channel of a recording: how many frames of each id, their greatest length, and the first frames in the order of their times."""

    name: str | int  # as the recording has it
    counts: Counter[FrameId] = field(default_factory=Counter)
    lengths: dict[FrameId, int] = field(default_factory=dict)
    frames: defaultdict[FrameId, list[tuple[int, can.Message]]] = field(default_factory=lambda: defaultdict(list))  # with their order
    kept: int = 0
    fd: bool = False

    def has(self, frame_id: FrameId) -> bool:
        return self.counts[frame_id] >= ALONE

    def of(self, ids: Iterable[FrameId]) -> list[can.Message]:
        """The kept frames with one of these ids, in their order."""
        found = sorted((pair for frame_id in set(ids) for pair in self.frames.get(frame_id, ())), key=itemgetter(0))
        return [message for _, message in found]


class Heard:
    """Remembers the traffic. `add` every message."""

    def __init__(self) -> None:
        self._channels: defaultdict[str | int, Channel] = defaultdict(lambda: Channel(""))

    def add(self, message: can.Message) -> None:
        if message.is_error_frame or message.is_remote_frame:
            return
        name = message.channel if isinstance(message.channel, int) else str(message.channel or "")
        channel = self._channels[name]
        channel.name = name
        frame_id = message.arbitration_id, message.is_extended_id
        channel.counts[frame_id] += 1
        channel.lengths[frame_id] = max(channel.lengths.get(frame_id, 0), len(message.data))
        channel.fd = channel.fd or message.is_fd
        if channel.kept < MOST_FRAMES:
            channel.frames[frame_id].append((channel.kept, message))
            channel.kept += 1

    @property
    def channels(self) -> list[Channel]:
        return [self._channels[name] for name in sorted(self._channels, key=str)]
