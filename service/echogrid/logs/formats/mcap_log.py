"""The CAN frames of an MCAP recording, with bounds on what a file may make us read and unpack."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO

import can
import lz4.frame  # type: ignore[import-untyped]  # it comes without types
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.writer import MCAP0_MAGIC

from echogrid.errors import EchogridError
from echogrid.topics.can_frame import LONGEST_NAME, decode_frame
from echogrid.topics.ros_definitions import CAN_FRAME, definition

MOST_BYTES = 32 << 20  # of a record or a chunk, packed or not; ours have 4 MiB
MOST_UNPACKED = 1000  # times the size of what was read, and MOST_BYTES more: no traffic packs so well
BUSES = "/can/"  # what topics with frames begin with; the bus's name follows
MOST_NAMED = 8  # channels that a sentence names

_HEAD = struct.Struct("<BQ")  # what every record begins with: opcode, size of the rest
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; behind them the payload


class McapLog:
    """Iterates over the frames of all buses in the file's order, which is that in which they were mapped.

    Raises EchogridError where no channel holds CAN frames; ValueError and what else its libraries stumble over for garbage and for a torn
    end, after the last frame that could be read.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._schemas: dict[int, tuple[str, bool]] = {}  # name, and whether it is that of our frames
        self._channels: list[str] = []  # the first ones
        self._buses: dict[int, str | int | None] = {}  # channels with frames, and what python-can called them

    def __iter__(self) -> Iterator[can.Message]:
        if self._file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise ValueError("it is not an MCAP file: it starts with other bytes")
        for opcode, body in all_records(self._file):
            if opcode == Opcode.MESSAGE:
                channel = MESSAGE.unpack_from(body)[0]
                if channel in self._buses:
                    yield decode_frame(body[MESSAGE.size :], self._buses[channel])
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(stream(body))
                ours = schema.name == CAN_FRAME and schema.data == definition(CAN_FRAME).encode()
                self._schemas[schema.id] = schema.name[:LONGEST_NAME], ours
            elif opcode == Opcode.CHANNEL:
                self._add(Channel.read(stream(body)))
        if not self._buses:
            found = ", ".join(self._channels[:MOST_NAMED]) + (", ..." if len(self._channels) > MOST_NAMED else "")
            raise EchogridError(
                f"{self._file.name}: holds no CAN frames: its channels are {found or 'none'}; expected one of type {CAN_FRAME}, "
                "as `echogrid run --record` and `echogrid replay --record` write it"
            )

    def _add(self, channel: Channel) -> None:
        name, ours = self._schemas.get(channel.schema_id, ("no type", False))
        if len(self._channels) <= MOST_NAMED:
            self._channels.append(f"{channel.topic[:LONGEST_NAME]} ({name})")
        if name != CAN_FRAME:
            return
        if channel.message_encoding != "cdr" or not ours:
            raise ValueError(f"the frames on {channel.topic[:LONGEST_NAME]} are in another format than this version writes")
        bus = channel.topic.removeprefix(BUSES)
        called = json.loads(channel.metadata.get("channel", json.dumps(bus)))  # tools of ROS copy the topic's name alone
        if not isinstance(called, str | int | None) or len(str(called)) > LONGEST_NAME:
            raise ValueError("a channel's name in python-can is not a name")
        self._buses[channel.id] = called


def all_records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Opcode and body of every record but those of the summary, those within chunks among them; `file` stands behind the magic.

    Raises ValueError for a torn end and what is too large, and what else its libraries stumble over.
    """
    left = MOST_BYTES
    for opcode, body in _records(file):
        if opcode == Opcode.DATA_END:
            return
        left += MOST_UNPACKED * len(body)
        if opcode != Opcode.CHUNK:
            yield opcode, body
            continue
        data = _unpacked(Chunk.read(stream(body)))
        left -= len(data)
        if left < 0:
            raise ValueError(f"it unpacks to more than {MOST_UNPACKED} times its size")
        yield from _records(BytesIO(data))
    raise ValueError("it was not closed, its last part may be missing")


def _records(file: BinaryIO | BytesIO) -> Iterator[tuple[int, bytes]]:
    """Opcode and body, up to the file's end."""
    while head := file.read(_HEAD.size):
        opcode, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
        if size > MOST_BYTES:
            raise ValueError(f"a record of {size} bytes, expected at most {MOST_BYTES}")
        body = file.read(size)
        if not opcode or len(body) != size:
            raise ValueError("it ends within a record, its last part is missing")
        yield opcode, body


def stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def _unpacked(chunk: Chunk) -> bytes:
    size = chunk.uncompressed_size
    if size > MOST_BYTES:
        raise ValueError(f"a chunk of {size} bytes, expected at most {MOST_BYTES}")
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor(max_window_size=MOST_BYTES).stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif not chunk.compression:
        data = chunk.data
    else:
        raise ValueError(f"a chunk is compressed by the unknown method '{chunk.compression[:LONGEST_NAME]}'")
    if len(data) != size or (chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc):
        raise ValueError("a chunk does not match its size or its checksum")
    return data
