"""AUTOSAR's end-to-end protection against published vectors, and in a profile.

The vectors of profiles 1, 2, 5 and 6 are those of the tests of the package autosar-e2e (github.com/zariiii9003/autosar-e2e, its files
test/test_p01.py to test_p06.py). Profile 11 is 1 with a fixed place, and has its vectors. Of 22, whose sum is that of profile 2, no
published vector was at hand: it is held against one that goes bit by bit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.places import DBC

from echogrid.can import e2e
from echogrid.can.dbc import Dbc
from echogrid.can.motion import MotionReader
from echogrid.can.profile import load_motion
from echogrid.config.tables import Motion
from echogrid.core.health import Health
from echogrid.errors import EchogridError

ZEROS, LIST = (0,) * 16, tuple(range(16))
VECTORS = [
    ("e2e.p01_both", (0x123,), "cc 00 00 00 00 00 00 00", "big", 0),
    ("e2e.p01_both", (0x123,), "91 01 00 00 00 00 00 00", "big", 0),
    ("e2e.p01_alternating", (0x123,), "ce 00 00 00 00 00 00 00", "big", 0),
    ("e2e.p01_alternating", (0x123,), "02 01 00 00 00 00 00 00", "big", 0),
    ("e2e.p01_low", (0x123,), "ce 00 00 00 00 00 00 00", "big", 0),
    ("e2e.p01_low", (0x123,), "93 01 00 00 00 00 00 00", "big", 0),
    ("e2e.p01_nibble", (0x123,), "2a 10 00 00 00 00 00 00", "big", 0),
    ("e2e.p01_nibble", (0x123,), "77 11 00 00 00 00 00 00", "big", 0),
    ("e2e.p11_both", (0x123,), "91 01 00 00 00 00 00 00", "big", 0),
    ("e2e.p11_nibble", (0x123,), "77 11 00 00 00 00 00 00", "big", 0),
    ("e2e.p02", ZEROS, "45 01 00 00 00 00 00 00", "big", 0),
    ("e2e.p02", LIST, "bc 02 02 03 04 05 06 07", "big", 0),
    ("e2e.p02", LIST, "61 01 02 03 04 05 06 07", "big", 0),
    ("e2e.p05", (0x1234,), "1c ca 00 00 00 00 00 00", "little", 0),
    ("e2e.p05", (0x1234,), "cf 8d 01 00 00 00 00 00", "little", 0),
    ("e2e.p05", (0x1234,), "00 00 00 00 00 00 00 00 fb d6 01 00 00 00 00 00", "little", 8),
    ("e2e.p06", (0x1234,), "b1 55 00 08 00 00 00 00", "big", 0),
    ("e2e.p06", (0x1234,), "f4 f5 00 08 01 00 00 00", "big", 0),
    ("e2e.p06", (0x1234,), "00 00 00 00 00 00 00 00 0b 17 00 10 01 00 00 00", "big", 8),
]


@pytest.mark.parametrize(("algorithm", "data_id", "frame", "order", "at"), VECTORS)
def test_the_published_vectors_hold_and_no_bit_may_change(
    algorithm: str, data_id: tuple[int, ...], frame: str, order: Literal["big", "little"], at: int
) -> None:
    sent = bytes.fromhex(frame)
    size = 2 if algorithm in ("e2e.p05", "e2e.p06") else 1
    compute = e2e.checksum(algorithm, data_id, 8 * size, at)

    def holds(payload: bytes) -> bool:
        found = int.from_bytes(payload[at : at + size], order)
        return compute(payload[:at] + payload[at + size :]) == found

    assert holds(sent)
    for bit in range(8 * len(sent)):
        wrong = bytearray(sent)
        wrong[bit // 8] ^= 1 << bit % 8
        assert not holds(bytes(wrong))
    other = tuple((one + 1) % 256 for one in data_id)
    assert e2e.checksum(algorithm, other, 8 * size, at)(sent[:at] + sent[at + size :]) != compute(sent[:at] + sent[at + size :])


def bit_by_bit(data: bytes) -> int:
    """CRC-8 of polynomial 0x2F, begun and ended with 0xFF."""
    value = 0xFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ 0x2F) & 0xFF if value & 0x80 else value << 1
    return value ^ 0xFF


@given(st.lists(st.integers(0, 255), min_size=16, max_size=16), st.binary(min_size=1, max_size=63))
def test_the_ids_of_profile_22_are_chosen_by_the_counter(ids: list[int], data: bytes) -> None:
    expected = bit_by_bit(data + bytes((ids[data[0] & 0x0F],)))
    assert e2e.checksum("e2e.p22", tuple(ids), 8, 0)(data) == expected


PROFILE = (DBC / "vehicle_motion.toml").read_text()
CRC = 'algorithm = "crc8.sae_j1850"'


def _reader(folder: Path, crc: str) -> MotionReader:
    path = folder / "mine.toml"
    assert CRC in PROFILE
    path.write_text(PROFILE.replace(CRC, crc))
    return MotionReader(load_motion(path), Dbc(DBC / "vehicle_motion.dbc", path), Motion(bus="can0"), Health())


def test_a_profile_takes_protected_frames_and_no_others(tmp_path: Path) -> None:
    """The shipped layout has its checksum first and its counter behind it, as profile 2 has."""
    reader = _reader(tmp_path, f'algorithm = "e2e.p02", data_id = {list(LIST)}')
    body = bytes((0x03, 0xE8, 0x03))
    for counter, accepted in ((5, True), (6, True), (7, False)):
        rest = bytes((0x10 | counter,)) + body[1:]
        crc = bit_by_bit(rest + bytes((LIST[counter] if accepted else 99,)))
        message = can.Message(arbitration_id=0x102, is_extended_id=False, data=bytes((crc,)) + rest)
        if accepted:
            assert reader.add(message, counter * 10_000_000)
        else:
            with pytest.raises(ValueError, match="wrong checksum"):
                reader.add(message, counter * 10_000_000)


@pytest.mark.parametrize(
    ("crc", "complaint"),
    [
        ('algorithm = "e2e.p02"', "e2e.p02 expects a data_id of 16 numbers from 0 to 255 and a checksum of 8 bits"),
        ('algorithm = "e2e.p02", data_id = 5', "e2e.p02 expects a data_id of 16 numbers"),
        ('algorithm = "e2e.p05", data_id = 5', "e2e.p05 expects a data_id of one number from 0 to 65535 and a checksum of 16 bits"),
        ('algorithm = "e2e.p11_nibble", data_id = 4096', "e2e.p11_nibble expects a data_id of one number from 0 to 4095"),
        ('algorithm = "crc8.sae_j1850", data_id = 5', "crc.data_id: 'crc8.sae_j1850' has none, expected one of e2e.p01_both, "),
        ('algorithm = "e2e.p03", data_id = 5', "crc.data_id: 'e2e.p03' has none"),
    ],
)
def test_what_does_not_fit_is_one_sentence(tmp_path: Path, crc: str, complaint: str) -> None:
    with pytest.raises(EchogridError) as caught:
        _reader(tmp_path, crc)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
