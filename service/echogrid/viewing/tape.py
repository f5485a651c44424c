"""A recorded scene: frames by the time of the drive, and now and then everything, so that one can begin anywhere."""

from __future__ import annotations

import bisect
import struct
import threading
from collections.abc import Iterable

import zstandard

from echogrid.errors import EchogridError
from echogrid.viewing.scene import Frames, Scene
from echogrid.viewing.wire import Kind

WHOLE_EVERY = 4.0  # s of the drive
MOST_BYTES = 1 << 30  # in memory, packed
_LENGTH = struct.Struct("<I")
LASTING = (Kind.HELLO, Kind.RESET, Kind.BLOCKS, Kind.TRAIL)  # of others only the newest counts


class Tape:
    """One thread adds, any may read. It may be read while it still grows; `done` is the share of the source that is on it."""

    def __init__(self) -> None:
        self.done = 0.0
        self.failure: str | None = None  # why it ends here
        self.begun_ns = 0  # stamp of the first entry
        self._times: list[float] = []  # s from `begun_ns` on, of each entry
        self._entries: list[bytes] = []
        self._wholes: list[tuple[int, bytes]] = []  # number of the entry after which it was taken
        self._bytes = 0
        self._lock = threading.Lock()

    def add(self, stamp_ns: int, frames: Frames, scene: Scene) -> None:
        """What became new at a time; one that lies before the last one's counts as that. Raises EchogridError where it is full."""
        if not frames:
            return
        if not self._times:
            self.begun_ns = stamp_ns
        time = max((stamp_ns - self.begun_ns) * 1e-9, self.end)
        whole = scene.whole() if not self._wholes or time - self._times[self._wholes[-1][0]] >= WHOLE_EVERY else None
        with self._lock:
            self._entries.append(self._packed(frames))
            self._times.append(time)
            if whole is not None:
                self._wholes.append((len(self._times) - 1, self._packed(whole)))
        if self._bytes > MOST_BYTES:
            raise EchogridError(f"the recording is too long to be shown at once: its first {self.end:.0f} s fill {MOST_BYTES >> 20} MiB")

    @property
    def empty(self) -> bool:
        """Whether there is no entry yet."""
        return not self._times

    @property
    def end(self) -> float:
        """s from the first entry to the last."""
        return self._times[-1] if self._times else 0.0

    def count(self, time: float) -> int:
        """How many entries there are up to a time."""
        with self._lock:
            return bisect.bisect_right(self._times, time)

    def next_at(self, number: int) -> float | None:
        """When the entry of that number is due; None where it is not there yet."""
        return self._times[number] if number < len(self._times) else None

    def between(self, first: int, last: int) -> Frames:
        """The frames of the entries from one number to before another."""
        with self._lock:
            packed = self._entries[first:last]
        return [frame for entry in packed for frame in _unpacked(entry)]

    def whole_before(self, count: int) -> tuple[Frames, int]:
        """Everything as it was at most WHOLE_EVERY before `count` entries, and how many entries are in it."""
        with self._lock:
            number = bisect.bisect_left(self._wholes, count, key=lambda whole: whole[0])
            if not self._wholes:
                return [], 0
            entry, packed = self._wholes[max(number - 1, 0)]
        return _unpacked(packed), entry + 1

    def _packed(self, frames: Frames) -> bytes:
        data = b"".join(_LENGTH.pack(len(frame)) + frame for frame in frames)
        packed = zstandard.ZstdCompressor(level=1).compress(data)
        self._bytes += len(packed)
        return packed


def _unpacked(packed: bytes) -> Frames:
    data, frames, at = zstandard.ZstdDecompressor().decompress(packed), [], 0
    while at < len(data):
        (length,) = _LENGTH.unpack_from(data, at)
        at += _LENGTH.size
        frames.append(data[at : at + length])
        at += length
    return frames


def newest(frames: Iterable[bytes]) -> Frames:
    """The same without the poses, points and states that later ones replace."""
    everything = list(frames)
    last = {frame[0]: number for number, frame in enumerate(everything)}
    return [frame for number, frame in enumerate(everything) if frame[0] in LASTING or last[frame[0]] == number]
