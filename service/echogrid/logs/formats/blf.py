"""Vector's BLF: objects in containers, most of them packed. What is broken is told and stepped over; all else is read."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np

from echogrid.can.intake.frames import FrameBatch
from echogrid.core.kernels.dispatch import loops
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.blf_objects import NAME, WANTED, decode
from echogrid.logs.formats.stream import Stream, Window, inflated

FILE_HEAD = struct.Struct("<4sI8xQQII8H8H")  # signature, size; sizes of file and content, objects, of them read; begin and end
BASE = struct.Struct("<4sHHII")  # what every object begins with: signature, header's size and version, object's size and type
CONTAINER = struct.Struct("<H6xI4x")  # method, unpacked size
IN_CONTAINER, STORED, DEFLATED = 10, 0, 2
MARK = b"LOBJ"
PIECE = 1 << 17  # bytes that are unpacked at once
BATCH = 1 << 19  # bytes of objects that are decoded at once
MOST_BYTES = 1 << 20  # of an object that holds a frame
MOST_SKIPPED, LAST_KIND = 1 << 28, 1 << 10  # of any object; what is more is none
_WANTED = np.isin(np.arange(LAST_KIND + 1), sorted(WANTED))


def read(stream: Stream, account: Account) -> Iterator[FrameBatch]:
    """The frames; channels as the file numbers them, from 1. Raises ValueError where the file begins otherwise."""
    window = Window(stream)
    head = bytes(window.take(FILE_HEAD.size))
    if len(head) < FILE_HEAD.size or head[:4] != b"LOGG":
        raise ValueError("it is no BLF file: it begins otherwise")
    _, size, promised, _, count, _, *dates = FILE_HEAD.unpack(head)
    window.skip(max(size - FILE_HEAD.size, 0))
    walk = _Walk(account, _seconds(dates[:8]))
    while window.fill(BASE.size):
        at = window.at
        signature, header, _, size, kind = BASE.unpack_from(window.data)
        if signature != MARK or not _likely(header, size, kind):
            yield from walk.rest()
            _step_over(window, walk, account)
        elif kind == IN_CONTAINER:
            yield from _container(window, walk, account, size)
            window.skip(size % 4)
        else:
            whole = min(size, MOST_BYTES)
            yield from walk.add(taken := window.take(whole))
            if len(taken) + window.skip(size - whole) < size:
                account.tear(f"its last object, at byte {at}, is torn")
            window.skip(size % 4)
    yield from walk.rest()
    if window.data.strip(b"\0"):
        account.tear(f"{len(window.data)} bytes follow its last whole object")
    if walk.left and not account.odd:
        account.tear(f"{walk.left} bytes follow its last whole object")
    found = window.at + len(window.data)
    if promised > found:
        account.tear(f"its head promises {promised} bytes, there are {found}")
    elif count > walk.objects and not account.odd and promised:
        account.note(f"its head promises {count} objects, there are {walk.objects}")


def _likely(header: int, size: int, kind: int) -> bool:
    """Whether an object may begin so."""
    return BASE.size <= header <= size <= MOST_SKIPPED and kind <= LAST_KIND


def _step_over(window: Window, walk: _Walk, account: Account) -> None:
    at = window.at
    zeros = skipped = window.skip_zeros()
    if not window.fill(1) and not walk.left:
        account.note(f"{zeros} zeros follow its last object")  # room that its recorder had made
        return
    if not (zeros and window.data.startswith(MARK)):
        skipped += len(window.take(1)) + window.skip_to(MARK)
    if window.fill(1):
        account.lost(f"{skipped} bytes at byte {at}")
    elif account.torn or window.at - skipped < at:
        return
    else:
        account.tear(f"{skipped} bytes follow its last whole object")
    walk.doubted = True


def _container(window: Window, walk: _Walk, account: Account, size: int) -> Iterator[FrameBatch]:
    """The frames of one container, unpacked piece by piece."""
    at, whole = window.at, False
    head = window.take(BASE.size + CONTAINER.size)
    left = size - len(head)
    if len(head) < BASE.size + CONTAINER.size or left < 0:
        account.tear(f"its last container, at byte {at}, is torn")
        return
    method, promised = CONTAINER.unpack_from(head, BASE.size)
    unpacker = zlib.decompressobj() if method == DEFLATED else None
    if method not in (STORED, DEFLATED):
        yield from walk.rest()
        account.lost(f"a container of {size} bytes at byte {at}, packed by the unknown method {method}")
        walk.doubted = True
        window.skip(left)
        return
    unpacked = 0
    try:
        while left > 0:
            window.fill(1)
            packed = bytes(window.take(min(left, len(window.data), PIECE)))
            if not packed:
                break
            left -= len(packed)
            for data in [packed] if unpacker is None else inflated(unpacker, packed, PIECE):
                unpacked += len(data)
                yield from walk.add(data)
        whole = left == 0 and (unpacker is None or unpacker.eof)
    except zlib.error:
        pass
    short = unpacker is not None and promised not in (0, unpacked)
    if not whole or short:
        yield from walk.rest()
    if not whole and left and not window.fill(1):
        account.tear(f"its last container, at byte {at}, is torn")
    elif not whole or short:
        account.lost(f"a container of {size} bytes at byte {at}, which cannot be unpacked to its end")
        walk.doubted = True
        found = window.data.find(MARK)
        window.skip(left if found < 0 or found >= left else found)  # its size may be the wrong thing about it
        return
    window.skip(left)


class _Walk:
    """Walks from object to object through what containers hold; an object may begin in one and end in the next."""

    def __init__(self, account: Account, start: float) -> None:
        self.account = account
        self.start = start  # s since 1970
        self.objects = 0
        self._data = bytearray()
        self._due = BATCH  # bytes that are waited for
        self._skip = 0  # bytes of an object that nobody wants
        self.doubted = False  # what comes next may not continue what came before

    @property
    def left(self) -> int:
        """Bytes of an object that has no end yet; after `rest`."""
        return len(self._data) if self._data.strip(b"\0") else 0

    def add(self, data: bytes | bytearray) -> Iterator[FrameBatch]:
        """The frames that end in this piece and in those before it, once they are many."""
        if self.doubted:
            self._join(data)
        if self._skip:
            step = min(self._skip, len(data))
            self._skip -= step
            data = data[step:]
        self._data += data
        if len(self._data) >= self._due:
            yield from self.rest()

    def rest(self) -> Iterator[FrameBatch]:
        """The frames that end in all pieces so far."""
        data = self._data
        places, kinds, at = self._walk(data)
        wanted = _WANTED[kinds]
        if not wanted.all():
            for kind, count in zip(*np.unique(kinds[~wanted], return_counts=True), strict=True):
                self.account.others[NAME.get(int(kind), "objects of other kinds")] += int(count)
            places, kinds = places[wanted], kinds[wanted]
        self.objects += len(wanted)
        if len(places):
            yield decode(data, places, kinds, self.start, self.account)
        self._data = data[at:]
        self._due = len(self._data) + BATCH

    def _walk(self, data: bytearray) -> tuple[np.ndarray, np.ndarray, int]:
        """Places and kinds of the objects, one after the other, and where the last one ends; what is none is told."""
        place, end = np.zeros(2, np.int64), len(data)
        places, kinds = np.empty((2, end // BASE.size), np.int64)
        whole = np.frombuffer(data, np.uint8)
        while True:
            loops.blf_objects(whole, place, places, kinds, _WANTED, BASE.size, MOST_SKIPPED, MOST_BYTES)
            at, count = int(place[0]), int(place[1])
            if end - at < BASE.size:
                break
            signature, header, _, size, kind = BASE.unpack_from(data, at)
            if signature != MARK or not _likely(header, size, kind) or (size > MOST_BYTES and kind in WANTED):
                place[0] += self._resync(data, at, count)
                continue
            if at + size > end:
                if kind in WANTED:
                    break
                self._skip, size = at + size - end, end - at
            places[count], kinds[count] = at, kind
            place[:] = at + size, count + 1
        return places[:count], kinds[:count], at

    def _join(self, data: bytes | bytearray) -> None:
        """Between two pieces something was lost. An object goes on in the second if where it should end another one begins."""
        self.doubted, self._skip = False, 0
        size = BASE.unpack_from(self._data)[3] if len(self._data) >= BASE.size else 0
        rest = size - len(self._data)
        if data.startswith(MARK) or rest <= 0 or MARK not in data[rest : rest + 7]:
            self._data = bytearray()

    def _resync(self, data: bytearray, at: int, objects: int) -> int:
        """How many bytes to step over. Up to 3 fill an object up; more are told."""
        begins = data.startswith(MARK, at)
        found = data.find(MARK, at + begins)
        step = (found if found >= 0 else max(len(data) - len(MARK) + 1, at + 1)) - at
        if begins or step >= len(MARK):
            self.account.lost(f"{step} bytes behind object {self.objects + objects} of its containers")
        return step


def _seconds(written: list[int]) -> float:
    """A date as Windows writes it, taken as UTC, in seconds since 1970; 0 for none."""
    year, month, _, day, hour, minute, second, milliseconds = written
    try:
        return datetime(year, month, day, hour, minute, second, milliseconds * 1000, tzinfo=UTC).timestamp()
    except ValueError:
        return 0.0
