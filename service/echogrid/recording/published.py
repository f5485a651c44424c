"""What a service published, out of a recording of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from echogrid.errors import EchogridError
from echogrid.recording.viewer_channel import recorded_channel
from echogrid.topics.cdr import body_of, read_text
from echogrid.topics.grids import Grid, decode_grid, decode_update
from echogrid.topics.points import JudgedPoints, decode_judged
from echogrid.topics.poses import Odometry, decode_odometry
from echogrid.topics.topic import JUDGED, KEY, META, ODOMETRY, STATUS, UPDATE


@dataclass(frozen=True, slots=True)
class Item:
    """One message, decoded; of the map what it was after it."""

    stamp_ns: int
    window: Grid | None = None
    odometry: Odometry | None = None
    judged: JudgedPoints | None = None
    status: dict[str, Any] | None = None
    meta: dict[str, Any] | None = None


class Published:
    """Iterates over the messages of an MCAP file that a viewer shows, in the file's order; `progress` is the share that was read.

    Raises EchogridError for a file that is none, and where it is torn or damaged, after the last message that could be read.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._size = path.stat().st_size
            self._file = path.open("rb")
        except OSError as error:
            raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error
        self.path = path
        self.frames = False  # whether there are CAN frames too
        self.malformed = 0  # messages that cannot be decoded
        self._key: Grid | None = None
        self._decoders: dict[str, Callable[[int, bytes], Item | None]] = {
            recorded_channel(KEY).topic: self._of_key,
            recorded_channel(UPDATE).topic: self._of_update,
            recorded_channel(ODOMETRY).topic: lambda stamp_ns, payload: Item(stamp_ns, odometry=decode_odometry(payload)),
            recorded_channel(JUDGED).topic: lambda stamp_ns, payload: Item(stamp_ns, judged=decode_judged(payload)),
            recorded_channel(STATUS).topic: lambda stamp_ns, payload: Item(stamp_ns, status=_object(payload)),
            recorded_channel(META).topic: lambda stamp_ns, payload: Item(stamp_ns, meta=_object(payload)),
        }

    @property
    def progress(self) -> float:
        return min(self._file.tell() / max(self._size, 1), 1.0) if not self._file.closed else 1.0

    def __iter__(self) -> Iterator[Item]:
        try:
            from mcap.opcode import Opcode
            from mcap.records import Channel
            from mcap.writer import MCAP0_MAGIC

            from echogrid.logs.formats.mcap_log import BUSES, MESSAGE, all_records, stream
        except ImportError as error:
            raise EchogridError(f"{self.path}: mcap is not installed: pip install mcap") from error
        decoders: dict[int, Callable[[int, bytes], Item | None]] = {}
        with self._file as file:
            try:
                if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                    raise ValueError("it is not an MCAP file: it starts with other bytes")
                for opcode, body in all_records(file):
                    if opcode == Opcode.CHANNEL:
                        channel = Channel.read(stream(body))
                        self.frames |= channel.topic.startswith(BUSES)
                        if channel.topic in self._decoders and channel.message_encoding == "cdr":
                            decoders[channel.id] = self._decoders[channel.topic]
                    elif opcode == Opcode.MESSAGE:
                        number, _, stamp_ns, _ = MESSAGE.unpack_from(body)
                        item = self._decoded(decoders.get(number), stamp_ns, body[MESSAGE.size :])
                        if item is not None:
                            yield item
            except EchogridError:
                raise
            except Exception as error:  # mcap, zstandard and struct raise what garbage makes them stumble over
                raise EchogridError(f"{self.path}: {error}") from error

    def _decoded(self, decode: Callable[[int, bytes], Item | None] | None, stamp_ns: int, payload: bytes) -> Item | None:
        try:
            return None if decode is None else decode(stamp_ns, payload)
        except ValueError:
            self.malformed += 1
            return None

    def _of_key(self, stamp_ns: int, payload: bytes) -> Item:
        self._key = decode_grid(payload)
        return Item(stamp_ns, window=self._key)

    def _of_update(self, stamp_ns: int, payload: bytes) -> Item | None:
        update, key = decode_update(payload), self._key
        if key is None:
            return None
        (height, width), cells = update.occupancy.shape, key.occupancy.copy()
        if update.x + width > cells.shape[1] or update.y + height > cells.shape[0]:
            raise ValueError("an update reaches beyond its key frame")
        cells[update.y : update.y + height, update.x : update.x + width] = update.occupancy
        return Item(stamp_ns, window=msgspec.structs.replace(key, stamp_ns=update.stamp_ns, occupancy=cells))


def _object(payload: bytes) -> dict[str, Any]:
    """The JSON object in a std_msgs/String."""
    text, _ = read_text(body_of(payload), 0)
    try:
        return msgspec.json.decode(text, type=dict[str, Any])
    except (msgspec.DecodeError, RecursionError) as error:
        raise ValueError(f"not a JSON object: {error}") from error
