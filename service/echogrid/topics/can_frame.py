"""A CAN frame as stored in a recording: echogrid_msgs/msg/CanFrame in CDR, with all that python-can's Message holds except its channel."""

from __future__ import annotations

import struct

import can

from echogrid.topics.cdr import LITTLE_ENDIAN, SECOND

MOST_DATA = 64  # bytes
LONGEST_NAME = 256  # characters of what python-can calls a channel
_STAMP = struct.Struct("<4siII")  # encapsulation, seconds, nanoseconds, length of the bus's name
_FRAME = struct.Struct("<dI7?BI")  # timestamp, id, flags, len, length of data


def stamp_ns(message: can.Message) -> int:
    """The frame's time in whole nanoseconds since 1970; exact arithmetic, because the product of a float loses them."""
    over, under = float(message.timestamp).as_integer_ratio()
    return (2 * over * SECOND + under) // (2 * under)


def encode_frame(bus: str, message: can.Message) -> bytes:
    """Raises ValueError for a message that is not a CAN frame; a log may hold such."""
    seconds, nanoseconds = divmod(stamp_ns(message), SECOND)
    name, count = bus.encode() + b"\0", len(message.data)
    try:
        head = _STAMP.pack(LITTLE_ENDIAN, seconds, nanoseconds, len(name)) + name
        # python-can's readers put a length or a code of one into dlc; only of a remote frame is it all there is.
        length = message.dlc if message.is_remote_frame else count
        frame = _FRAME.pack(message.timestamp, message.arbitration_id, *_flags(message), length, count)
    except struct.error as error:
        raise ValueError(f"not a CAN frame: {error}") from error
    if count > MOST_DATA:
        raise ValueError(f"not a CAN frame: it has {count} bytes of data, expected at most {MOST_DATA}")
    return b"".join((head, bytes(-(len(head) - len(LITTLE_ENDIAN)) % 8), frame, message.data))


def decode_frame(payload: bytes, channel: str | int | None) -> can.Message:
    """The very message that was encoded; `channel` is what its channel was. Raises ValueError."""
    try:
        encapsulation, _, _, length = _STAMP.unpack_from(payload)
        at = _STAMP.size + length
        at += -(at - len(LITTLE_ENDIAN)) % 8
        timestamp, number, *flags, dlc, count = _FRAME.unpack_from(payload, at)
    except struct.error as error:
        raise ValueError(f"a frame's message ends after {len(payload)} bytes") from error
    data = payload[at + _FRAME.size :]
    if encapsulation != LITTLE_ENDIAN or len(data) != count or count > MOST_DATA:
        raise ValueError(f"a message of {len(payload)} bytes with {count} of data is not a frame's")
    extended, remote, fault, fd, switch, state, received = flags
    return can.Message(
        timestamp=timestamp,
        arbitration_id=number,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=fault,
        is_fd=fd,
        bitrate_switch=switch,
        error_state_indicator=state,
        is_rx=received,
        channel=channel,
        dlc=dlc,
        data=data,
    )


def _flags(message: can.Message) -> tuple[bool, ...]:
    return (
        message.is_extended_id,
        message.is_remote_frame,
        message.is_error_frame,
        message.is_fd,
        message.bitrate_switch,
        message.error_state_indicator,
        message.is_rx,
    )
