"""ROS 2's CDR (XCDR1, plain, little endian): what its messages are made of. They are in `grids`, `poses`, `points`, `diagnostic_array`.

Encoders raise ValueError where a stamp or a name has no place in the message. Decoders take bytes from anywhere: they raise
ValueError with one sentence, nothing else, and allocate nothing larger than the payload.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

from echogrid.errors import EchogridError

LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # alignment counts from the byte behind it
SECOND = 10**9  # ns
_STAMP = struct.Struct("<iI")  # builtin_interfaces/Time: until 2038
LENGTH = struct.Struct("<I")
NAMES = 64  # that are remembered as bytes


class StampError(EchogridError, ValueError):
    """A time that ROS has no stamp for: the machine's clock is wrong, or it is later than January 2038."""


def encode_header(stamp_ns: int, frame: str) -> bytes:
    """std_msgs/Header, padded to 4 for what follows."""
    seconds, nanoseconds = divmod(stamp_ns, SECOND)
    if not -(2**31) <= seconds < 2**31:
        what = f"the clock says {stamp_ns / SECOND:.3f} s since 1970"
        raise StampError(f"{what}, which does not fit into the 32-bit seconds of ROS's stamps, those until January 2038: set the clock")
    return _STAMP.pack(seconds, nanoseconds) + encode_name(frame)


@lru_cache(NAMES)
def encode_name(name: str) -> bytes:
    """A string that is said in message after message, such as a frame's name, padded to 4 for what follows."""
    return padded(encode_text(name), 4)


def encode_text(text: str) -> bytes:
    """A string: its length with the NUL that ends it, its UTF-8, the NUL."""
    data = text.encode()
    if 0 in data:
        raise ValueError(f"the name {text!r} holds a NUL")
    return LENGTH.pack(len(data) + 1) + data + b"\0"


def encode_string(text: str) -> bytes:
    """std_msgs/String, a whole message. Raises ValueError where it holds a NUL."""
    return LITTLE_ENDIAN + encode_text(text)


def with_texts(body: bytes, texts: Iterable[str]) -> bytes:
    """The body and behind it each text, from the next multiple of 4 on."""
    for text in texts:
        body = padded(body, 4) + encode_text(text)
    return body


def aligned(at: int, size: int) -> int:
    """The next multiple of `size` from `at` on."""
    return at + -at % size


def padded(data: bytes, size: int) -> bytes:
    """The data with zeros up to the next multiple of `size`."""
    return data + bytes(-len(data) % size)


def body_of(payload: bytes) -> memoryview:
    """What is behind the encapsulation header."""
    if payload[:4] != LITTLE_ENDIAN:
        raise ValueError(f"the payload begins with {payload[:4].hex(' ') or 'nothing'}, expected plain little-endian CDR")
    return memoryview(payload)[4:]


def read(layout: struct.Struct, body: memoryview, at: int) -> tuple[Any, ...]:
    """The values of a layout at an offset."""
    if len(body) < at + layout.size:
        raise ValueError(f"the message ends at byte {len(body)}, expected at least {at + layout.size}")
    return layout.unpack_from(body, at)


def read_header(body: memoryview, at: int = 0) -> tuple[int, str, int]:
    """Stamp in ns, frame, and where the next 4-byte value begins."""
    seconds, nanoseconds = read(_STAMP, body, at)
    if nanoseconds >= SECOND:
        raise ValueError(f"the stamp has {nanoseconds} ns beside its seconds")
    frame, at = read_text(body, at + _STAMP.size)
    return seconds * SECOND + nanoseconds, frame, aligned(at, 4)


def read_text(body: memoryview, at: int) -> tuple[str, int]:
    """A name, and where it ends."""
    (length,) = read(LENGTH, body, at)
    start, stop = at + LENGTH.size, at + LENGTH.size + length
    data = bytes(body[start:stop])
    if len(data) != length or not data.endswith(b"\0") or 0 in data[:-1]:
        raise ValueError(f"a name of {length} bytes does not end with the only NUL in it")
    try:
        return data[:-1].decode(), stop
    except UnicodeDecodeError as error:
        raise ValueError(f"a name is not UTF-8 from its byte {error.start} on") from error


def read_texts(body: memoryview, at: int, count: int) -> tuple[list[str], int]:
    """So many texts, each from the next multiple of 4 on, and where the last ends."""
    texts = []
    for _ in range(count):
        text, at = read_text(body, aligned(at, 4))
        texts.append(text)
    return texts, at
