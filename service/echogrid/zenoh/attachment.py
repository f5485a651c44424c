"""What goes beside every sample: for rmw_zenoh its number, time and source, and beside our grids which map they are of.

Decoders take bytes from anywhere and raise ValueError, nothing else.
"""

from __future__ import annotations

import struct

GID_SIZE = 16
_ATTACHMENT = struct.Struct("<qqB")
_VERSION = struct.Struct("<Iq")


def encode_attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """What rmw_zenoh wants beside every sample: its number (from 1), its source's time and the publisher's 16-byte id. 33 bytes."""
    if len(gid) != GID_SIZE:
        raise ValueError(f"a gid of {len(gid)} bytes, expected {GID_SIZE}")
    return _ATTACHMENT.pack(sequence, stamp_ns, GID_SIZE) + gid


def decode_attachment(attachment: bytes) -> tuple[int, int, bytes]:
    """Sequence number, stamp_ns, gid."""
    if len(attachment) != _ATTACHMENT.size + GID_SIZE or attachment[_ATTACHMENT.size - 1] != GID_SIZE:
        raise ValueError(f"an attachment of {len(attachment)} bytes is not rmw_zenoh's")
    sequence, stamp_ns, _ = _ATTACHMENT.unpack_from(attachment)
    return sequence, stamp_ns, attachment[_ATTACHMENT.size :]


def encode_version(epoch: int, keyframe: int) -> bytes:
    """What follows that beside our own grids: which map, and which key frame it is or was made for. 12 bytes."""
    return _VERSION.pack(epoch, keyframe)


def decode_grid_attachment(attachment: bytes) -> tuple[int, int, bytes, int, int]:
    """Sequence number, stamp_ns, gid, epoch, key frame."""
    first = len(attachment) - _VERSION.size
    if first < 0:
        raise ValueError(f"an attachment of {len(attachment)} bytes is not that of a grid")
    return *decode_attachment(attachment[:first]), *_VERSION.unpack_from(attachment, first)
