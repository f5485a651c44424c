"""Databases that cantools reads are decoded as by cantools, whatever their signals: ARXML here, KCD and SYM in test_dbc.py."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import pytest
from cantools.database.can import Database as ByCantools
from hypothesis import given
from hypothesis import strategies as st
from tests.support import arxml

from echogrid.can import foreign_database
from echogrid.can.decode import BatchDecoder, stack

pytestmark = pytest.mark.hypothesis
LENGTHS = {"unsigned": (1, 64), "signed": (2, 64)}


@st.composite
def signals(draw: st.DrawFn, size: int) -> list[arxml.Signal]:
    """Up to six that fit into the frame; cantools decodes none that overlap."""
    found: list[arxml.Signal] = []
    taken: set[int] = set()
    for name in "ABCDEF"[: draw(st.integers(1, 6))]:
        kind = draw(st.sampled_from(["unsigned", "signed", *(["float"] if size >= 8 else [])]))
        most = min(size * 8, 64)
        length = draw(st.sampled_from([32, 64])) if kind == "float" else draw(st.integers(LENGTHS[kind][0], most))
        motorola, at = draw(st.booleans()), draw(st.integers(0, size * 8 - length))
        bits = {n // 8 * 8 + 7 - n % 8 if motorola else n for n in range(at, at + length)}
        if bits & taken:
            continue
        taken |= bits
        start = at // 8 * 8 + 7 - at % 8 if motorola else at  # Motorola's most significant bit: the at-th as the bits are sent
        scale, offset = (1, 0) if kind == "float" else (draw(st.integers(1, 9)), draw(st.integers(-99, 99)))
        found.append(arxml.Signal(name, start, length, motorola, kind, scale, offset))
    return found


@given(data=st.data(), size=st.sampled_from([1, 3, 8, 20, 64]), extended=st.booleans())
def test_arxml_is_decoded_as_by_cantools(data: st.DataObject, size: int, extended: bool) -> None:
    text = arxml.text(0x1FFFFFFF if extended else 0x7FF, extended, size, data.draw(signals(size)))
    payloads = data.draw(st.lists(st.binary(min_size=size, max_size=size), min_size=1, max_size=6))
    (ours,) = foreign_database.parse(Path("some.arxml"), text.encode()).messages
    theirs = ByCantools(strict=False)
    theirs.add_arxml_string(text)
    by_cantools = theirs.get_message_by_name("Frame")
    assert (ours.frame_id, ours.is_extended_frame, ours.length) == (by_cantools.frame_id, by_cantools.is_extended_frame, size)
    decoder = BatchDecoder(ours)
    assert len(decoder.names) == len(by_cantools.signals)
    for row, payload in zip(decoder.decode(stack(payloads, size)), payloads, strict=True):
        values: Any = by_cantools.decode(payload, decode_choices=False)
        for name, value in zip(decoder.names, row, strict=True):
            expected = float(values[name])
            assert struct.pack("<d", value) == struct.pack("<d", expected) or (math.isnan(value) and math.isnan(expected))
