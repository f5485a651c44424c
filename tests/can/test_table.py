"""Who reads which frame of which bus, and what it says: many at once against each reader asked about one."""

from __future__ import annotations

from pathlib import Path

import can
import numpy as np
import pytest
from tests.support.frames import frame, wheel_speeds, yaw_rate

from echogrid.can.dbc import Dbc
from echogrid.can.decode import stack
from echogrid.can.intake.frames import FrameBatch
from echogrid.can.intake.table import UNKNOWN_BUS, Table
from echogrid.can.motion import MotionReader
from echogrid.can.profile import find, load_motion
from echogrid.config.tables import Motion
from echogrid.core.health import Health

FLOATS = """BU_: T R

BO_ 256 W: 8 T
 SG_ L : 0|32@1- (1,0) [0|0] "" R
 SG_ Q : 32|32@1- (1,0) [0|0] "" R

BO_ 258 Y: 5 T
 SG_ Rate : 0|32@1- (1,0) [0|0] "" R
 SG_ Way : 32|2@1+ (1,0) [0|0] "" R

SIG_VALTYPE_ 256 L : 1;
SIG_VALTYPE_ 256 Q : 1;
SIG_VALTYPE_ 258 Rate : 1;
"""
OF_FLOATS = """kind = "motion"
[wheel_speeds]
message = "W"
rear_left = { signal = "L", unit = "m/s" }
rear_right = { signal = "Q", unit = "m/s" }
[yaw_rate]
message = "Y"
yaw_rate = { signal = "Rate", unit = "rad/s" }
[direction]
message = "Y"
signal = "Way"
reverse = [2]
"""
NUMBERS = {"first": 0, "second": 1, "third": 2}


def motion(path: Path) -> MotionReader:
    profile = load_motion(path)
    return MotionReader(profile, Dbc(path.parent / str(profile.dbc or "floats.dbc"), path), Motion(bus="can0"), Health())


@pytest.fixture
def readers(tmp_path: Path) -> dict[str, MotionReader]:
    """By bus, of the same ids: integers, which the loops read, and floats, which they cannot; and one of a bus that is not there."""
    (tmp_path / "floats.dbc").write_text(FLOATS)
    (tmp_path / "floats.toml").write_text(OF_FLOATS)
    shipped = find("vehicle_motion", Path())
    return {"first": motion(shipped), "second": motion(tmp_path / "floats.toml"), "elsewhere": motion(shipped)}


def messages() -> list[can.Message]:
    """Of both kinds, forward and in reverse; cut off, longer than is read, and of an id that nobody reads."""
    found = [wheel_speeds(speed, n, 1.0) for n, speed in enumerate((7.5, -2.5, 0.25))] + [yaw_rate(0.25, 9, 1.0), yaw_rate(-0.5, 3, 1.0)]
    found += [frame(0x100, np.array((1.5, -8.25), "<f4").tobytes(), 1.0), frame(0x102, np.float32(-0.75).tobytes() + b"\2", 1.0)]
    found += [frame(0x100, bytes(4), 1.0), frame(0x102, bytes(3), 1.0), frame(0x102, bytes(range(8)), 1.0), frame(0x101, bytes(8), 1.0)]
    return found


def test_what_frames_say_is_what_the_reader_of_their_bus_finds_in_each(readers: dict[str, MotionReader]) -> None:
    table = Table({(bus, one): reader for bus, reader in readers.items() for one in sorted(reader.ids)}, NUMBERS)
    heard = [(bus, message) for message in messages() for bus in (*NUMBERS, None)]
    buses = np.array([UNKNOWN_BUS if bus is None else NUMBERS[bus] for bus, _ in heard])
    intake = table.intake(FrameBatch.of([message for _, message in heard]), buses)
    told = dict(zip(intake.others, intake.said, strict=True))
    sound = dict.fromkeys(readers, 0)
    for n, (bus, message) in enumerate(heard):
        reader, frame_id = None if bus is None else readers.get(bus), (message.arbitration_id, False)
        if bus is None or reader is None or frame_id not in reader.ids:
            assert n not in told
            continue
        role, _, wrong, values, counted = told[n]
        assert table.others[role] == (reader, frame_id)
        check = reader.checks[frame_id]
        try:
            payload = check.payload(bytes(message.data))
        except ValueError:
            assert wrong
            continue
        assert not wrong
        sound[bus] += 1
        np.testing.assert_array_equal(values, reader.values(frame_id, stack([payload], check.length))[0])
        way = reader.direction.raw(payload) if reader.direction is not None and frame_id == reader.direction_id else 0
        assert counted == [check.number(payload), way]
    assert sound == {"first": 5, "second": 6, "elsewhere": 0}
