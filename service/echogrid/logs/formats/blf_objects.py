"""The frames among BLF's objects. Many are decoded at once, as columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from can.util import dlc2len

from echogrid.can.intake.frames import ERROR, EXTENDED, REMOTE, SENT, STATE, SWITCH, FrameBatch
from echogrid.can.intake.frames import FD as FLEXIBLE
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.times import END_OF_TIME, TOO_LATE

IS_EXTENDED = 0x80000000
CAN, CAN2, CAN_ERROR, ERROR_EXT, FD, FD64, FD_ERROR64 = 1, 86, 2, 73, 100, 101, 104
WANTED = frozenset((CAN, CAN2, CAN_ERROR, ERROR_EXT, FD, FD64, FD_ERROR64))
ERRORS = (CAN_ERROR, ERROR_EXT, FD_ERROR64)
NAMES = {  # objects that are no frames
    "overload frames": (3,),
    "bus statistics": (4,),
    "triggers": (5,),
    "variables": (6, 7, 8, 9, 72),
    "states of the controller": (31, 74, 112),
    "comments": (65, 92, 96),
    "unused objects": (115,),
    "CAN XL frames": (131, 132),
    "objects of LIN": (*range(11, 22), *range(54, 64), 75, 76, 77, 78, 79, 87, 88, 89, 91, 98, 99, 105, 106, 107, 122, 123),
    "objects of MOST": (*range(22, 27), 32, 33, 34, 35, *range(80, 86)),
    "objects of FlexRay": (*range(27, 31), *range(40, 52), 66, 67, 68),
    "objects of Ethernet": (71, 93, 94, 102, 103, 113, 114, 120, 121),
}
NAME = {kind: name for name, kinds in NAMES.items() for kind in kinds}
_SIZES = [("header", "<u2"), ("version", "<u2"), ("size", "<u4"), ("kind", "<u4")]
_HEAD = np.dtype([("", "V4"), *_SIZES, ("flags", "<u4"), ("", "V4"), ("stamp", "<u8")])
_CLASSIC = np.dtype([("channel", "<u2"), ("flags", "u1"), ("dlc", "u1"), ("id", "<u4")])
_FD = np.dtype([*_CLASSIC.descr, ("", "V5"), ("fd", "u1"), ("count", "u1"), ("", "V5")])
_FD64_BEGIN = [("channel", "u1"), ("dlc", "u1"), ("count", "u1"), ("", "V1"), ("id", "<u4"), ("", "V4"), ("fd", "<u4")]
_FD64 = np.dtype([*_FD64_BEGIN, ("", "V18"), ("way", "u1"), ("offset", "u1"), ("", "V4")])
_ERROR_EXT = np.dtype([("channel", "<u2"), ("", "V8"), ("dlc", "u1"), ("", "V5"), ("id", "<u4"), ("", "V4")])
_ERROR, _ERROR64 = np.dtype([("channel", "<u2")]), np.dtype([("channel", "u1")])
BODIES = {CAN: _CLASSIC, CAN2: _CLASSIC, FD: _FD, FD64: _FD64, ERROR_EXT: _ERROR_EXT, CAN_ERROR: _ERROR, FD_ERROR64: _ERROR64}
MOST_BYTES = 64
LENGTHS = np.array([dlc2len(code) for code in range(256)])


def decode(data: bytearray, places: np.ndarray, kinds: np.ndarray, start: float, account: Account) -> FrameBatch:
    """The frames of the objects that begin at `places` of `data`, in that order; `start`: s since 1970.

    An object that does not hold what its kind has, or a time or an id that cannot be, is told to the account.
    """
    heads = _records(data, places, _HEAD)
    unit = np.where(heads["flags"] == 1, 1e5, 1e9)
    stamps = heads["stamp"] / unit + start
    begins = places + heads["header"]
    rooms = heads["size"].astype(np.int64) - heads["header"]
    sound = ((heads["version"] == 1) | (heads["version"] == 2)) & (heads["header"] >= _HEAD.itemsize) & (stamps < END_OF_TIME)
    size, told, there = len(places), np.zeros(len(places), bool), np.empty(len(places), np.int64)
    ids, flags, dlc, sizes = np.empty(size, np.uint32), np.empty(size, np.uint8), np.empty(size, np.uint8), np.empty(size, np.uint8)
    channels = np.empty(size, np.int32)
    for kind in np.flatnonzero(np.bincount(kinds)).tolist():
        body = BODIES[kind]
        mine = np.flatnonzero(sound & (kinds == kind) & (rooms >= body.itemsize))
        columns = _columns(
            kind, _records(data, begins[mine], body), heads["header"][mine].astype(np.int64) + body.itemsize, rooms[mine] - body.itemsize
        )
        if not columns.sound.all():
            mine, columns = mine[columns.sound], _Columns(*(column[columns.sound] for column in columns))
        flags[mine] = ERROR * (kind in ERRORS)
        bits = (columns.extended, columns.remote, columns.is_fd, ~columns.received, columns.switch, columns.state)
        for bit, column in zip((EXTENDED, REMOTE, FLEXIBLE, SENT, SWITCH, STATE), bits, strict=True):
            flags[mine] |= column * np.uint8(bit)
        ids[mine], channels[mine], dlc[mine] = columns.codes, columns.channel, columns.dlc
        sizes[mine] = np.where(columns.remote, 0, columns.length)
        there[mine] = np.where(columns.remote, 0, columns.there)
        begins[mine] += body.itemsize
        told[mine] = True
        account.errors += len(mine) if kind in ERRORS else 0
        account.remote += int(columns.remote.sum())
    for index in np.flatnonzero(~told).tolist():
        late = f", where {TOO_LATE.format(stamps[index])}" if stamps[index] >= END_OF_TIME else ""
        account.lost(f"an object of kind {kinds[index]}, {places[index]} bytes into what its container holds{late}")
    short = np.flatnonzero(told & (there < sizes))
    filled = b"".join(bytes(data[begins[n] : begins[n] + there[n]]).ljust(MOST_BYTES, b"\0") for n in short.tolist())
    begins[short] = len(data) + np.arange(len(short)) * MOST_BYTES
    payloads = np.frombuffer(data + filled if filled else data, np.uint8)
    found = FrameBatch(stamps, ids, flags, dlc, sizes, begins, payloads, channels)
    return found if told.all() else found.where(told)


def _records(data: bytearray, at: np.ndarray, kind: np.dtype) -> np.ndarray:
    """What lies at places that are aligned to nothing; all zero where that would be beyond the end."""
    room = len(data) - kind.itemsize + 1
    if room <= 0 or (len(at) and int(at[-1]) >= room):
        data, room = data + bytes(kind.itemsize), len(data) + 1
    found: np.ndarray = np.ndarray(room, f"V{kind.itemsize}", data, strides=(1,))[at]  # whole, which is faster than field by field
    return found.view(kind)


class _Columns(NamedTuple):
    codes: np.ndarray
    extended: np.ndarray
    remote: np.ndarray
    channel: np.ndarray
    dlc: np.ndarray
    length: np.ndarray
    there: np.ndarray  # bytes of data in the object, which may be fewer
    is_fd: np.ndarray
    received: np.ndarray
    switch: np.ndarray
    state: np.ndarray
    sound: np.ndarray


def _columns(kind: int, body: np.ndarray, before: np.ndarray, room: np.ndarray) -> _Columns:
    """One kind's fields; `before`: bytes of the object up to their end, `room`: behind it."""
    no, yes, none = np.zeros(len(body), bool), np.ones(len(body), bool), np.zeros(len(body), np.int64)
    if kind in (CAN_ERROR, FD_ERROR64):
        return _Columns(none, yes, no, body["channel"], none, none, none, no, yes, no, no, yes)
    codes, extended = body["id"] & 0x1FFFFFFF, body["id"] & IS_EXTENDED != 0
    sound = extended | (codes <= 0x7FF)
    if kind == ERROR_EXT:
        length = np.minimum(np.minimum(body["dlc"], 8), room)
        return _Columns(codes, extended, no, body["channel"], length, length, length, no, yes, no, no, yes)
    if kind in (CAN, CAN2):
        remote, length = body["flags"] & 0x80 != 0, np.minimum(body["dlc"], 8)
        return _Columns(
            codes, extended, remote, body["channel"], length, length, length, no, body["flags"] & 1 == 0, no, no, sound & (length <= room)
        )
    length = body["count"].astype(np.int64)
    if kind == FD:
        remote, received, there = body["flags"] & 0x80 != 0, body["flags"] & 1 == 0, length
        is_fd, switch, state = (body["fd"] & flag != 0 for flag in (1, 2, 4))
    else:
        remote, is_fd, switch, state = (body["fd"] & flag != 0 for flag in (0x10, 0x1000, 0x2000, 0x4000))
        received = body["way"] == 0
        # Bytes that are zero at the end may be left out, and behind them another structure may follow.
        offset = body["offset"].astype(np.int64)
        there = np.minimum(length, np.where(offset > 0, np.minimum(offset - before, room), room)).clip(0)
        room = np.maximum(room, length)
    dlc = np.where(remote, np.where(is_fd, LENGTHS[body["dlc"]], np.minimum(body["dlc"], 8)), length)
    sound &= length <= np.minimum(room, MOST_BYTES)
    return _Columns(codes, extended, remote, body["channel"], dlc, length, there, is_fd, received, switch, state, sound)
