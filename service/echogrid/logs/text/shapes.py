"""Lines of one shape, as a table of letters: what is the same of all is asked once, and numbers are read column by column."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Letters = NDArray[np.uint8]  # (lines, letters)
Indices = NDArray[np.int64]
MOST_SHAPES = 8  # of lines of one length; the rest is read line by line
LONGEST = 1024  # letters
MOST_DIGITS = 18
EXACT = 2**53  # a smaller whole number is exact as a float, and its quotient by a power of ten is what float() makes of the digits
BLANK, POINT, SMALL = ord(" "), ord("."), 0x20
_DIGIT = np.full(256, 255, np.uint8)
for _value, _letter in enumerate(b"0123456789abcdef"):
    _DIGIT[_letter] = _value
    _DIGIT[ord(chr(_letter).upper())] = _value


class Shape(NamedTuple):
    """Lines whose blanks stand in the same places."""

    lines: Indices  # (n,) which of the lines they are
    letters: Letters  # (n, length)
    words: list[tuple[int, int]]  # first and last + 1 column of each word

    def texts(self, word: int) -> Iterator[str]:
        """(n,) the word of each line."""
        begin, end = self.words[word]
        if (one := self.text(word)) is not None:
            return repeat(one, len(self.lines))
        found = np.ascontiguousarray(self.letters[:, begin:end]).view(f"V{end - begin}")[:, 0].tolist()
        known = {word: word.decode("latin-1") for word in set(found)}
        return map(known.__getitem__, found)

    def text(self, word: int) -> str | None:
        """A word that is the same in all lines, else None."""
        begin, end = self.words[word]
        found = self.letters[:, begin:end]
        return found[0].tobytes().decode("latin-1") if (found == found[0]).all() else None

    def digits(self, word: int, base: int = 10, cut: int = 0) -> Indices:
        """(n,) whole numbers, without the `cut` last letters of each. Raises ValueError."""
        begin, end = self.words[word]
        return _number(self.letters[:, begin : end - cut], base)

    def decimals(self, word: int) -> NDArray[np.float64]:
        """(n,) numbers with a point or without, each as float() gives it. Raises ValueError."""
        begin, end = self.words[word]
        points = np.flatnonzero(self.letters[0, begin:end] == POINT)
        if not len(points):
            return self.digits(word).astype(np.float64)
        if len(points) != 1 or not 0 < points[0] < end - begin - 1 or (self.letters[:, begin + points[0]] != POINT).any():
            raise ValueError("no number with a point")
        behind = int(end - begin - 1 - points[0])
        whole = _number(np.delete(self.letters[:, begin:end], points[0], axis=1), 10)
        if whole.max() >= EXACT:
            raise ValueError("more digits than a float has")
        return whole / 10.0**behind

    def is_letter(self, word: int, yes: str, no: str) -> NDArray[np.bool_]:
        """(n,) which of two words of the same length stands there. Raises ValueError for another."""
        begin, end = self.words[word]
        if end - begin != len(yes):
            raise ValueError("another word")
        found = self.letters[:, begin:end]
        are, are_not = ((found == np.frombuffer(one.encode(), np.uint8)).all(axis=1) for one in (yes, no))
        if not (are | are_not).all():
            raise ValueError("another word")
        said: NDArray[np.bool_] = are
        return said

    def payloads(self, word: int, size: int) -> list[bytes]:
        """(n,) bytes that stand there as two digits each, with one blank between. Raises ValueError."""
        if not size:
            return [b""] * len(self.lines)
        begin = self.words[word][0] if word < len(self.words) else -1
        if self.words[word : word + size] != [(at, at + 2) for at in range(begin, begin + 3 * size, 3)]:
            raise ValueError("not two digits for each byte")
        return self.bytes_at(begin, size, 3)

    def bytes_at(self, begin: int, size: int, step: int) -> list[bytes]:
        """(n,) bytes of two digits each, from column `begin` on, each `step` behind the one before. Raises ValueError."""
        last = begin + step * (size - 1) + 2
        high, low = (_DIGIT[self.letters[:, begin + at : last : step]] for at in (0, 1))
        if ((high | low) > 15).any():
            raise ValueError("no digits")
        taken: list[bytes] = np.ascontiguousarray(high << 4 | low).view(f"V{size}")[:, 0].tolist()
        return taken


def shapes(lines: list[bytes], marks: bytes = b" ") -> Iterator[Shape]:
    """The lines by shape; those of rare shapes, with tabs, or very long are left out. `marks` stand in the same places in all lines."""
    lengths = np.fromiter(map(len, lines), np.int64, len(lines))
    data = b"\n".join(lines)
    begins = np.cumsum(lengths + 1) - lengths - 1
    for length in np.flatnonzero(np.bincount(lengths[lengths <= LONGEST])).tolist():
        if not length:
            continue
        same = np.flatnonzero(lengths == length)
        rows = np.ndarray(len(data) - length + 1, f"V{length}", data, strides=(1,))[begins[same]].view(np.uint8).reshape(-1, length)
        for _ in range(MOST_SHAPES):
            fits = np.ones(len(rows), np.bool_)
            for mark in marks:
                there = rows == mark
                fits &= (there == there[0]).all(axis=1)
            yield Shape(same[fits], rows[fits], _words(rows[0] == BLANK))
            if fits.all():
                break
            same, rows = same[~fits], rows[~fits]


def _words(blank: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([True], blank, [True])).astype(np.int8))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _number(letters: Letters, base: int) -> Indices:
    if not 0 < letters.shape[1] <= MOST_DIGITS:
        raise ValueError("no number")
    digits = _DIGIT[letters]
    if (digits >= base).any():
        raise ValueError("no digits")
    value = np.zeros(len(letters), np.int64)
    for column in digits.T:
        value = value * base + column
    return value
