"""Checksums as tables of bytes: the same sums that the algorithms themselves give, right ones and wrong ones."""

from __future__ import annotations

import fastcrc
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from echogrid.can import e2e
from echogrid.can.dbc import Checksum
from echogrid.can.decode import SignalLayout
from echogrid.can.intake.checks import table_of

LISTED = tuple(range(7, 247, 15))
E2E = [(name, (0x123,) if name in e2e.BY_ID else LISTED, e2e.BY_ID[name][1] if name in e2e.BY_ID else 8) for name in e2e.ALGORITHMS]


def layout(first: int, bits: int, *, intel: bool) -> SignalLayout:
    return SignalLayout(first if intel else first + bits // 8 - 1, 1 if intel else -1, 0, bits, False, False, 1, 0)


@pytest.mark.parametrize(("name", "ids", "bits"), [*E2E, ("crc8.sae_j1850", (), 8), ("crc16.xmodem", (), 16), ("crc32.iso_hdlc", (), 32)])
@settings(max_examples=40)
@given(payload=st.binary(min_size=8, max_size=8), first=st.integers(0, 3), intel=st.booleans(), counter=st.integers(0, 255))
def test_a_table_sums_as_the_algorithm_does(
    tables: dict[tuple[str, int, bool], NDArray[np.uint64]],
    name: str,
    ids: tuple[int, ...],
    bits: int,
    payload: bytes,
    first: int,
    intel: bool,
    counter: int,
) -> None:
    """With a counter that often has the nibble which the id asks for."""
    place = layout(first, bits, intel=intel)
    module, _, function = name.partition(".")
    compute = e2e.checksum(name, ids, bits, first) if ids else getattr(getattr(fastcrc, module), function)
    checksum = Checksum(place, compute)
    behind = first + bits // 8
    payload = payload[:behind] + bytes([counter & 0x0F | 0x10 if counter & 1 else counter]) + payload[behind + 1 :]
    table = tables.get((name, first, intel))
    if table is None:
        table = tables[name, first, intel] = table_of(checksum, 8)
    found = int(np.bitwise_xor.reduce(table[np.arange(8), list(payload)]))
    expected = compute(checksum.others(payload))
    assert found == expected if expected >= 0 else found >= 1 << 40
    right = bytearray(payload)
    right[first:behind] = (found & (1 << bits) - 1).to_bytes(bits // 8, "little" if intel else "big")
    assert checksum.holds(bytes(right)) == (expected >= 0)


@pytest.fixture(scope="module")
def tables() -> dict[tuple[str, int, bool], NDArray[np.uint64]]:
    return {}


def test_a_checksum_at_the_end_is_summed_too() -> None:
    checksum = Checksum(layout(7, 8, intel=True), fastcrc.crc8.sae_j1850)
    table = table_of(checksum, 8)
    for payload in (bytes(8), bytes(range(8)), b"\xff" * 8):
        assert int(np.bitwise_xor.reduce(table[np.arange(8), list(payload)])) == checksum.compute(payload[:7])
