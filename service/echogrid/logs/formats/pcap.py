"""Captures of SocketCAN: pcap and pcapng with link type 227, as tcpdump, Wireshark and dumpcap write them."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import Frame, FrameBatch, batches
from echogrid.logs.formats.account import Account, UntimelyError
from echogrid.logs.formats.stream import Stream, Window
from echogrid.logs.formats.times import END_OF_TIME, TOO_LATE, timely

SOCKETCAN = 227
COOKED = {113, 276}  # of all interfaces at once, which are not told apart there
LINKS = {1: "Ethernet"} | dict.fromkeys(COOKED, "any interface")
EFF, RTR, ERR = 0x80000000, 0x40000000, 0x20000000
MAGIC = {b"\xd4\xc3\xb2\xa1": ("<", 1e6), b"\xa1\xb2\xc3\xd4": (">", 1e6), b"\x4d\x3c\xb2\xa1": ("<", 1e9), b"\xa1\xb2\x3c\x4d": (">", 1e9)}
SECTION, INTERFACE, SIMPLE, ENHANCED = 0x0A0D0D0A, 1, 3, 6
BLOCKS = {4: "names", 5: "statistics", 10: "secrets", 2: "packets of an old form"}
MOST_BYTES = 1 << 18  # of a packet or a block
LONGEST = 2080  # bytes of a packet, one of CAN XL
STEP = 1 << 12  # bytes that are looked through at once where something was lost
YEAR = 366 * 86400.0


def read(stream: Stream, account: Account) -> Iterator[FrameBatch]:
    """The frames. pcapng names interfaces, or numbers them, here from 1; pcap does not say channels.

    Raises ValueError where the file begins otherwise, or has no SocketCAN at all.
    """
    window = Window(stream)
    window.fill(24)
    if bytes(window.data[:4]) in MAGIC:
        frames = _pcap(window, account)
    elif window.data[:4] == b"\x0a\x0d\x0d\x0a":
        frames = _Blocks(window, account).frames()
    else:
        raise ValueError("it is no capture: it begins otherwise")
    yield from batches(frames)


def _pcap(window: Window, account: Account) -> Iterator[Frame]:
    order, unit = MAGIC[bytes(window.data[:4])]
    head = window.take(24)
    if len(head) < 24:
        account.tear("it ends within its head")
        return
    link = struct.unpack(order + "I", head[20:])[0] & 0x0FFFFFFF
    if link != SOCKETCAN:
        raise ValueError(_other_link(link))
    record, lost, lost_at, newest, run = struct.Struct(order + "IIII"), 0, 0, 0.0, 0
    late = ""
    while window.fill(record.size):
        seconds, fraction, size, whole = record.unpack_from(window.data)
        stamp, there, packet = seconds + fraction / unit, Account(), b""
        likely = size <= whole and size <= LONGEST and fraction < unit and stamp < END_OF_TIME and (not lost or size == whole)
        if likely:
            window.fill(record.size + size + record.size)
            packet = bytes(window.data[record.size : record.size + size])
        if likely and len(packet) < size and not lost:
            break
        frame = _frame(packet, stamp, None, there) if likely else None
        near = abs(stamp - newest) < YEAR if run else not lost
        if frame is None or not (near or ((not lost or run < 2) and _goes_on(window.data, record.size + size, record, unit, stamp))):
            if not lost:
                lost_at = window.at
                late = f", where {TOO_LATE.format(stamp)}" if stamp >= END_OF_TIME and size == whole else ""
            lost += len(window.take(_unlikely(window, order, unit, newest if run > 1 else 0.0)))
            continue
        if lost:
            account.lost(f"{lost} bytes at byte {lost_at}{late}")
            lost = 0
        newest, run = stamp, run + 1 if near else 1
        window.take(record.size + size)
        if isinstance(frame, str):
            account.others[frame] += 1
            continue
        account.remote += there.remote
        account.errors += there.errors
        yield frame
    if lost or window.data:
        account.tear(f"{lost + len(window.data)} bytes follow its last whole packet{late if lost else ''}")


def _unlikely(window: Window, order: str, unit: float, newest: float) -> int:
    """How many of the next bytes no packet begins at; `newest`: s, of the one before, 0 for none."""
    window.fill(STEP)
    words = _words(window.data[:STEP], order)
    seconds, fraction, size, whole = (words[at : len(words) - 12 + at] for at in (0, 4, 8, 12))
    may = (size == whole) & (size <= LONGEST) & (fraction < unit) & (np.abs(seconds - newest) < (YEAR if newest else END_OF_TIME))
    found = np.flatnonzero(may[1:])
    return int(found[0]) + 1 if len(found) else max(len(may), 1)


def _words(data: bytearray, order: str) -> NDArray[np.int64]:
    """The 32-bit words that begin at each byte."""
    return np.ndarray(max(len(data) - 3, 0), f"{order}u4", bytes(data), strides=(1,)).astype(np.int64)


def _goes_on(data: bytearray, at: int, record: struct.Struct, unit: float, stamp: float) -> bool:
    """Whether another packet may begin there, not too far in time from the one before."""
    if len(data) < at + record.size:
        return False
    seconds, fraction, size, whole = record.unpack_from(data, at)
    return bool(size <= whole and size <= LONGEST and fraction < unit and abs(seconds - stamp) < YEAR)


@dataclass(slots=True)
class _Interface:
    link: int
    name: str | int
    per_second: float = 1e6
    offset: int = 0  # s


class _Blocks:
    """Remembers the section's byte order and interfaces."""

    def __init__(self, window: Window, account: Account) -> None:
        self.window, self.account = window, account
        self.order = "<"
        self.interfaces: list[_Interface] = []
        self.links: set[int] = set()

    def frames(self) -> Iterator[Frame]:
        window, account = self.window, self.account
        lost, lost_at = 0, 0
        while window.fill(12):
            size = self._size()
            if size == 0 or not window.fill(size) or window.data[size - 4 : size] != window.data[4:8]:
                if size and lost == 0 and not window.fill(size) and len(window.data) < size:
                    rest = bytes(window.data[4:])
                    if not self._another(rest):
                        break
                lost_at = lost_at if lost else window.at
                lost += len(window.take(self._unlikely()))
                continue
            if lost:
                account.lost(f"{lost} bytes at byte {lost_at}")
                lost = 0
            block = bytes(window.take(size))
            try:
                frame = self._block(block)
            except (ValueError, struct.error, IndexError) as error:
                why = f", where {error}" if isinstance(error, UntimelyError) else ""
                account.lost(f"a block of {size} bytes at byte {window.at - size}{why}")
                continue
            if frame is not None:
                yield frame
        if lost or window.data:
            account.tear(f"{lost + len(window.data)} bytes follow its last whole block")
        if self.links and SOCKETCAN not in self.links:
            raise ValueError(_other_link(*self.links))

    def _size(self) -> int:
        """Of the block that begins here; 0 where none does."""
        kind = bytes(self.window.data[:4])
        if kind == b"\x0a\x0d\x0d\x0a":
            magic = bytes(self.window.data[8:12])
            order = {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}.get(magic)
            if order is None:
                return 0
            self.order = order
        size = int(struct.unpack_from(self.order + "I", self.window.data, 4)[0])
        code = struct.unpack_from(self.order + "I", self.window.data)[0]
        return size if 12 <= size <= MOST_BYTES and size % 4 == 0 and _is_block(code) else 0

    def _unlikely(self) -> int:
        """How many of the next bytes no block begins at, in either byte order."""
        self.window.fill(STEP)
        data = self.window.data[: STEP + MOST_BYTES]
        may = np.zeros(max(min(len(data), STEP) - 7, 0), np.bool_)
        for order in "<>":
            size = _words(data[:STEP], order)[4:]
            may |= (size >= 12) & (size <= MOST_BYTES) & (size % 4 == 0)
        for at in (np.flatnonzero(may[1:]) + 1).tolist():
            for order in "<>":
                code, size = struct.unpack_from(order + "II", data, at)
                if _is_block(code) and size >= 12 and (at + size > len(data) or data[at + size - 4 : at + size] == data[at + 4 : at + 8]):
                    return int(at)
        return max(len(may), 1)

    def _another(self, rest: bytes) -> bool:
        """Whether a whole block lies in what is left: then the size of this one was junk."""
        for at in range(len(rest) - 12):
            size = int(struct.unpack_from(self.order + "I", rest, at + 4)[0])
            if 12 <= size <= len(rest) - at and size % 4 == 0 and rest[at + size - 4 : at + size] == rest[at + 4 : at + 8]:
                return True
        return False

    def _block(self, block: bytes) -> Frame | None:
        kind = struct.unpack_from(self.order + "I", block)[0]
        body, others = block[8:-4], self.account.others
        if kind == SECTION:
            self.interfaces = []
        elif kind == INTERFACE:
            self._interface(body)
        elif kind == ENHANCED:
            number, high, low, size, _ = struct.unpack_from(self.order + "5I", body)
            interface = self.interfaces[number]
            if interface.link != SOCKETCAN:
                others["packets of other interfaces"] += 1
                return None
            if size > len(body) - 20:
                raise ValueError("no packet")
            stamp = timely((high << 32 | low) / interface.per_second + interface.offset)
            return _told(body[20 : 20 + size], stamp, interface.name, self.account)
        elif kind == SIMPLE:
            others["packets without a time"] += 1
            self.account.note("it has packets without a time, which were left out")
        else:
            others[BLOCKS.get(kind, "blocks of other kinds")] += 1
        return None

    def _interface(self, body: bytes) -> None:
        link = struct.unpack_from(self.order + "H", body)[0]
        self.links.add(link)
        found = _Interface(link, len(self.interfaces) + 1)
        at = 8
        while at + 4 <= len(body):
            code, size = struct.unpack_from(self.order + "HH", body, at)
            value = body[at + 4 : at + 4 + size]
            if code == 0:
                break
            if code == 2 and value:
                found.name = value.rstrip(b"\0").decode("ascii", "backslashreplace")[:64]
            elif code == 9 and value:
                found.per_second = float(2 ** (value[0] & 0x7F) if value[0] & 0x80 else 10 ** min(value[0], 18))
            elif code == 14 and size == 8:
                found.offset = struct.unpack(self.order + "q", value)[0]
            at += 4 + size + -size % 4
        self.interfaces.append(found)


def _other_link(*links: int) -> str:
    """Of a capture of no CAN interface."""
    said = ", ".join(f"{link} ({LINKS[link]})" if link in LINKS else f"{link}" for link in sorted(links))
    how = ": capture the interfaces themselves, as with tcpdump -i can0" if COOKED & set(links) else ""
    return f"its link type{'s are' if len(links) > 1 else ' is'} {said}, expected {SOCKETCAN} (SocketCAN){how}"


def _is_block(code: int) -> bool:
    """Whether it is a kind of block that there is; those above are anyone's own."""
    return code in (SECTION, INTERFACE, SIMPLE, ENHANCED, *BLOCKS, 0xBAD, 0x40000BAD) or code & 0x80000000 != 0


def _told(packet: bytes, stamp: float, channel: str | int | None, account: Account) -> Frame | None:
    """A packet's frame; what is none is told to the account."""
    frame = _frame(packet, stamp, channel, account)
    if isinstance(frame, str):
        account.others[frame] += 1
        return None
    if frame is None:
        account.lost(f"a packet of {len(packet)} bytes, of {stamp:.6f} s")
    return frame


def _frame(packet: bytes, stamp: float, channel: str | int | None, account: Account) -> Frame | str | None:
    """A frame, the name of what else it is, or None where it is nothing that is known."""
    if len(packet) < 8:
        return None
    code, length, flags = struct.unpack_from(">IBB", packet)
    if length & 0x80:
        return "CAN XL frames"
    fd = bool(flags & 4) or len(packet) == 72 or length > 8
    if length > (64 if fd else 8) or len(packet) > (72 if fd else 16) or (not code & RTR and len(packet) < 8 + length):
        return None
    remote, failed = bool(code & RTR) and not code & ERR and not fd, bool(code & ERR)
    extended = bool(code & EFF) or failed
    identifier = code & 0x1FFFFFFF
    if not extended and identifier > 0x7FF:
        return None
    account.remote += remote
    account.errors += failed
    data = b"" if remote else packet[8 : 8 + length]
    return Frame(stamp, identifier, extended, remote, failed, channel, length, data, fd, True, fd and flags & 1 != 0, fd and flags & 2 != 0)
