"""A recording's bytes, unpacked, as chunks, lines or objects, with bounds on what a small file may unpack to."""

from __future__ import annotations

import codecs
import zlib
from collections.abc import Iterator
from typing import BinaryIO, cast

import zstandard

from echogrid.logs.formats.account import Account

CHUNK = 1 << 19  # bytes
PACKED = 1 << 16  # bytes that are read at once of a gzip file
LONGEST_LINE = 1 << 16  # bytes
STEP = 32  # bytes of deflate that are unpacked at once where they break
PIECE = 512  # bytes of zstd that are unpacked at once: no more than 16 MiB can come of them
WINDOW = 64 << 20  # bytes that zstd may look back
WIDE = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
GZIP = b"\x1f\x8b"


class Stream:
    """Remembers how far a file has been unpacked. A torn or broken end is told to the account; all bytes before it are given."""

    def __init__(self, raw: BinaryIO, packing: str, account: Account) -> None:
        """`packing`: ".gz", ".zst" or "" for none."""
        self.account = account
        self.name = raw.name
        self.length = 0  # bytes so far, unpacked
        self._raw, self._packing = raw, packing

    def chunks(self) -> Iterator[bytes]:
        """All of the file, once."""
        source = {"": self._plain, ".gz": self._gzip, ".zst": self._zstd}[self._packing]()
        for chunk in source:
            if chunk:
                self.length += len(chunk)
                yield chunk

    def _plain(self) -> Iterator[bytes]:
        while chunk := self._raw.read(CHUNK):
            yield chunk

    def _gzip(self) -> Iterator[bytes]:
        unpacker, data, begun = zlib.decompressobj(31), b"", False
        try:
            while data := data or self._raw.read(PACKED):
                if not begun:
                    data = data.lstrip(b"\0") if self.length else data  # tapes and some writers fill up with zeros
                    if self.length and data and not data.startswith(GZIP[: len(data)]):
                        self.account.tear("behind its packed data follows something else")
                        return
                    begun = bool(data)
                yield from inflated(unpacker, data, CHUNK)
                data = b""
                if unpacker.eof:
                    unpacker, data, begun = zlib.decompressobj(31), unpacker.unused_data, False
        except zlib.error as error:
            self.account.tear(f"its packed data is not sound ({error})")
            return
        if begun:
            self.account.tear("its packed data ends before its end")

    def _zstd(self) -> Iterator[bytes]:
        unpacker, data, begun = _zstd(), b"", False
        try:
            while data := data or self._raw.read(PIECE):
                begun = True
                yield unpacker.decompress(data)
                data = b""
                if unpacker.eof:
                    unpacker, data, begun = _zstd(), unpacker.unused_data, False
        except zstandard.ZstdError as error:
            self.account.tear(f"its packed data is not sound ({error})")
            return
        if begun:
            self.account.tear("its packed data ends before its end")

    def file(self) -> BinaryIO:
        """For those who read from files: of the file's methods, read alone."""
        return cast(BinaryIO, _File(self))

    def blocks(self) -> Iterator[tuple[int, int, bytes]]:
        """Whole lines: the number of the first, how many, and their text. Any line end, any code page; of UTF-16, only ASCII stays what it
        was.

        A line that is too long to be one is told to the account and left out; so is the lack of a last line's end.
        """
        rest, number, too_long = b"", 1, False
        for chunk in self._text():
            data = rest + chunk
            cut = max(data.rfind(b"\n"), data.rfind(b"\r", 0, len(data) - 1)) + 1
            rest, data = data[cut:], data[:cut]
            if too_long and data:
                data, too_long = data[len(data.splitlines()[0]) :], False
            count = data.count(b"\n") + data.count(b"\r") - data.count(b"\r\n")
            if len(rest) > LONGEST_LINE or too_long:
                if not too_long:
                    self.account.line(number + count, rest)
                rest, too_long = b"", True
            yield number, count, data
            number += count
        if rest:
            self.account.note("its last line has no end, it may be torn")
            yield number, 1, rest

    def _text(self) -> Iterator[bytes]:
        chunks = self.chunks()
        first = next(chunks, b"")
        while len(first) < 3 and (more := next(chunks, b"")):
            first += more
        encoding = WIDE.get(first[:2])
        if encoding is None:
            yield first.removeprefix(codecs.BOM_UTF8)
            yield from chunks
            return
        decoder = codecs.getincrementaldecoder(encoding)("replace")
        yield decoder.decode(first[2:]).encode("utf-8", "replace")
        for chunk in chunks:
            yield decoder.decode(chunk).encode("utf-8", "replace")


def inflated(unpacker: zlib._Decompress, data: bytes, most: int) -> Iterator[bytes]:
    """What comes of the next bytes, `most` at once; where they are not sound, all that comes of those before, and zlib.error is raised."""
    while data:
        before = unpacker.copy()
        try:
            found = unpacker.decompress(data, most)
        except zlib.error:
            for at in range(0, len(data), STEP):
                yield before.decompress(data[at : at + STEP])
            raise
        yield found
        data = unpacker.unconsumed_tail


def _zstd() -> zstandard.ZstdDecompressionObj:
    return zstandard.ZstdDecompressor(max_window_size=WINDOW).decompressobj()


class Window:
    """The next bytes of a stream, to be looked at before they are taken. `at`: how many were taken."""

    def __init__(self, stream: Stream) -> None:
        self.at = 0
        self.data = bytearray()
        self._chunks = stream.chunks()

    def fill(self, count: int) -> bool:
        """Whether so many bytes are there."""
        while len(self.data) < count:
            chunk = next(self._chunks, b"")
            if not chunk:
                return False
            self.data += chunk
        return True

    def take(self, count: int) -> bytearray:
        """The next bytes, fewer at the end."""
        self.fill(count)
        taken = self.data[:count]
        del self.data[:count]
        self.at += len(taken)
        return taken

    def skip(self, count: int) -> int:
        """Takes bytes without keeping them; says how many there were."""
        skipped = 0
        while skipped < count and (self.data or self.fill(1)):
            skipped += len(self.take(min(count - skipped, max(len(self.data), 1))))
        return skipped

    def skip_zeros(self) -> int:
        """Takes zeros; says how many."""
        skipped = 0
        while self.data or self.fill(1):
            rest = len(self.data.lstrip(b"\0"))
            skipped += len(self.take(len(self.data) - rest))
            if rest:
                break
        return skipped

    def skip_to(self, mark: bytes) -> int:
        """Takes bytes up to the next mark, or to the end; says how many."""
        skipped = 0
        while (found := self.data.find(mark)) < 0:
            skipped += len(self.take(max(len(self.data) - len(mark) + 1, 0)))
            if not self.fill(len(self.data) + 1):
                return skipped + len(self.take(len(self.data)))
        return skipped + len(self.take(found))


class _File:
    def __init__(self, stream: Stream) -> None:
        self.name = stream.name
        self._window = Window(stream)

    def read(self, count: int) -> bytes:
        return bytes(self._window.take(count))
