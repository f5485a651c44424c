"""Vector's BLF through python-can, with bounds on what a file may make us read and unpack."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Generator
from typing import BinaryIO

import can

MOST_BYTES = 64 << 20  # of a header or object, packed or not; writers fill containers of some 100 KiB
MOST_INSIDE = 1 << 20  # of an object in a container: an incomplete one is joined with what follows, over and over
BASE = struct.Struct("<4sHHII")  # what every object begins with: signature, header's size and version, object's size and type
CONTAINER = struct.Struct("<H6xI4x")  # method, unpacked size
IN_CONTAINER, STORED, DEFLATED = 10, 0, 2


class Blf(can.BLFReader):
    """Raises ValueError where python-can would go round in circles, or take memory without end."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__(_Bounded(file))  # type: ignore[arg-type]  # python-can only reads and closes it

    def __iter__(self) -> Generator[can.Message, None, None]:
        while base := self.file.read(BASE.size):
            signature, _, _, size, kind = BASE.unpack(base)
            if signature != b"LOBJ":
                raise ValueError("no object where one should start")
            body = self.file.read(size - BASE.size)
            self.file.read(size % 4)
            if kind == IN_CONTAINER:
                data = _unpacked(body)
                _check_sizes(self._tail + data)
                yield from self._parse_container(data)
        self.stop()


class _Bounded:
    """A file from which at most MOST_BYTES are read at once."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.close = file.close

    def read(self, count: int) -> bytes:
        if not 0 <= count <= MOST_BYTES:
            raise ValueError(f"an object of {count} bytes")
        return self._file.read(count)


def _unpacked(body: bytes) -> bytes:
    method, _ = CONTAINER.unpack_from(body)
    packed = body[CONTAINER.size :]
    if method == STORED:
        return packed
    if method != DEFLATED:
        raise ValueError(f"a container is compressed by the unknown method {method}")
    unpacker = zlib.decompressobj()
    data = unpacker.decompress(packed, MOST_BYTES)
    if unpacker.unconsumed_tail:
        raise ValueError(f"a container unpacks to more than {MOST_BYTES >> 20} MiB")
    return data


def _check_sizes(data: bytes) -> None:
    """Raises ValueError where an object does not even hold its own beginning: python-can would read it again and again."""
    at = data.find(b"LOBJ")
    while 0 <= at <= len(data) - BASE.size:
        size = BASE.unpack_from(data, at)[3]
        if not BASE.size <= size <= MOST_INSIDE:
            raise ValueError(f"an object of {size} bytes")
        at = data.find(b"LOBJ", at + size, at + size + 8)
