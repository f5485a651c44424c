"""The batch decoder against cantools, on generated DBC messages: any byte order, sign, float, multiplexor, length."""

from __future__ import annotations

import math
import struct

import cantools
import numpy as np
import pytest
from cantools.database.can import Message as Theirs
from hypothesis import given
from hypothesis import strategies as st

from echogrid.can import dbc_file
from echogrid.can.database import Message
from echogrid.can.decode import BatchDecoder, layout_of, stack


def _bit_positions(start: int, length: int, motorola: bool) -> list[int] | None:
    """DBC bit numbers of a signal, or None where it would leave a 64-byte payload."""
    if not motorola:
        return list(range(start, start + length))
    positions, bit = [], start
    for _ in range(length):
        positions.append(bit)
        bit = bit - 1 if bit % 8 else bit + 15
    return positions


Both = tuple[Message, Theirs]


def read_by_both(text: str) -> Both:
    """The only message of a DBC file, as we read it and as cantools does."""
    (ours,) = dbc_file.parse(text.encode()).messages
    return ours, cantools.database.load_string(text, "dbc").messages[0]


@st.composite
def dbc_messages(draw: st.DrawFn) -> Both:
    """One message of 1 to 64 bytes with signals that do not overlap within their multiplexor branch."""
    size = draw(st.integers(1, 64))
    lines: list[str] = []
    multiplexed = draw(st.booleans()) and size > 1
    taken: set[int] = set()
    branches: dict[int, set[int]] = {}
    if multiplexed:
        lines.append(' SG_ Mux M : 0|4@1+ (1,0) [0|0] "" R')
        taken |= set(range(4))
    for number in range(draw(st.integers(1, 12))):
        motorola = draw(st.booleans())
        is_float = draw(st.integers(0, 5)) == 0
        length = draw(st.sampled_from((32, 64))) if is_float else draw(st.integers(1, 64))
        positions = _bit_positions(draw(st.integers(0, 8 * size - 1)), length, motorola)
        if positions is None or max(positions) >= 8 * size:
            continue
        branch = draw(st.integers(0, 15)) if multiplexed and draw(st.booleans()) else None
        busy = taken | (branches.get(branch, set()) if branch is not None else set().union(*branches.values()))
        if busy & set(positions):
            continue
        (taken if branch is None else branches.setdefault(branch, set())).update(positions)
        scale = draw(st.sampled_from((1, 2, -3, 0.5, 0.1, 0.015625, 0.0003834, 12345.678)))
        offset = draw(st.sampled_from((0, 1, -100, 0.25, -67.67, -3.1416)))
        sign = draw(st.sampled_from("+-"))
        mux = "" if branch is None else f" m{branch}"
        lines.append(f' SG_ S{number}{mux} : {positions[0]}|{length}@{0 if motorola else 1}{sign} ({scale},{offset}) [0|0] "" R')
        if is_float:
            lines.append(f"FLOAT {number} {1 if length == 32 else 2}")
    signals = [line for line in lines if not line.startswith("FLOAT")]
    floats = [line.split()[1:] for line in lines if line.startswith("FLOAT")]
    text = f"BU_: T R\n\nBO_ 256 Message: {size} T\n" + "\n".join(signals) + "\n\n"
    text += "".join(f"SIG_VALTYPE_ 256 S{number} : {kind};\n" for number, kind in floats)
    return read_by_both(text)


def _same_bits(one: float, other: float) -> bool:
    return struct.pack("<d", one) == struct.pack("<d", other) or (math.isnan(one) and math.isnan(other))


@given(dbc_messages(), st.data())
def test_equal_to_cantools_bit_for_bit(both: Both, data: st.DataObject) -> None:
    message, by_cantools = both
    payloads = data.draw(st.lists(st.binary(min_size=message.length, max_size=message.length), min_size=1, max_size=4))
    decoder = BatchDecoder(message)
    ours = decoder.decode(stack(payloads, message.length))
    for row, payload in zip(ours, payloads, strict=True):
        try:
            theirs = by_cantools.decode(payload, decode_choices=False)
        except cantools.database.errors.DecodeError:  # a multiplexor value that no signal has: only the plain ones are there
            theirs = {s.name: None for s in by_cantools.signals if not s.multiplexer_ids}
        for name, value in zip(decoder.names, row, strict=True):
            if name not in theirs:
                assert math.isnan(value)
            elif theirs[name] is not None:
                assert _same_bits(value, float(theirs[name])), (name, value, theirs[name])


@pytest.mark.parametrize("offset", ["0", "-100", "7.0", "0.25", "-3.1416"])
@pytest.mark.parametrize("scale", ["1", "-3", "3.0", "7", "0.1"])
def test_what_does_not_fit_a_float_is_rounded_as_often_as_by_cantools(scale: str, offset: str) -> None:
    """64 bits; cantools takes a number without a point for an integer, and whole numbers where both are."""
    text = f'BU_: T R\n\nBO_ 256 Message: 8 T\n SG_ Wide : 0|64@1- ({scale},{offset}) [0|0] "" R\n'
    message, by_cantools = read_by_both(text)
    payloads = [
        n.to_bytes(8, "little", signed=True) for n in (2**53 + 1, 2**53 + 3, -(2**55) - 3, 2**60 + 129, 9007199254740539 * 901, -(2**63))
    ]
    ours = BatchDecoder(message).decode(stack(payloads, 8))[:, 0]
    for value, payload in zip(ours, payloads, strict=True):
        assert _same_bits(value, float(by_cantools.decode(payload)["Wide"]))


@pytest.mark.parametrize("bits", [0x7F800001, 0xFF800001, 0x7F800000, 0xFF800000, 0x7F7FFFFF])
def test_a_float_that_is_no_number_is_decoded_without_a_word(bits: int) -> None:
    """Signalling NaN, infinity, the largest there is: warnings are errors here, and would fill the journal in the car."""
    text = "BU_: T R\n\nBO_ 256 Message: 12 T\n"
    text += ' SG_ Short : 0|32@1- (3,-100) [0|0] "" R\n SG_ Long : 32|64@1- (12345.678,0) [0|0] "" R\n\n'
    text += "SIG_VALTYPE_ 256 Short : 1;\nSIG_VALTYPE_ 256 Long : 2;\n"
    message, by_cantools = read_by_both(text)
    payload = bits.to_bytes(4, "little") + bytes(4) + bits.to_bytes(4, "little")
    ours = BatchDecoder(message).decode(stack([payload], 12))[0]
    theirs = by_cantools.decode(payload)
    assert _same_bits(ours[0], theirs["Short"])
    assert _same_bits(ours[1], theirs["Long"])


@given(dbc_messages(), st.data())
def test_single_payload_extraction_equals_cantools(both: Both, data: st.DataObject) -> None:
    message, by_cantools = both
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    try:
        theirs = by_cantools.decode(payload, decode_choices=False, scaling=False)
    except cantools.database.errors.DecodeError:
        return
    for signal in message.signals:
        if signal.name in theirs and not signal.is_float:
            assert layout_of(signal).raw(payload) == theirs[signal.name]


def test_nested_multiplexors() -> None:
    """Extended multiplexing: the inner selector counts only where the outer one lets it exist."""
    text = """BU_: T R

BO_ 256 Message: 8 T
 SG_ Outer M : 0|4@1+ (1,0) [0|0] "" R
 SG_ Inner m1M : 4|4@1+ (1,0) [0|0] "" R
 SG_ Leaf m2 : 8|16@1- (0.5,0) [0|0] "" R
 SG_ Other m0 : 8|16@1+ (1,0) [0|0] "" R

SG_MUL_VAL_ 256 Inner Outer 1-1;
SG_MUL_VAL_ 256 Leaf Inner 2-3;
SG_MUL_VAL_ 256 Other Outer 0-0;
"""
    message, _ = read_by_both(text)
    decoder = BatchDecoder(message, ["Leaf", "Other"])
    payloads = [bytes((selectors, 0xFE, 0xFF, 0, 0, 0, 0, 0)) for selectors in (0x21, 0x31, 0x41, 0x20)]
    leaf, other = decoder.decode(stack(payloads, 8)).T
    np.testing.assert_array_equal(leaf, [-1.0, -1.0, np.nan, np.nan])
    np.testing.assert_array_equal(other, [np.nan, np.nan, np.nan, 65534.0])
