"""Ego motion from our frames and from those of real cars, encoded by cantools."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.frames import frame, wheel_speeds, yaw_rate

from echogrid.can.dbc import Dbc
from echogrid.can.motion import MotionReader
from echogrid.can.profile import find, load_motion
from echogrid.config.tables import Motion
from echogrid.core.health import Health
from echogrid.core.messages import Speed, YawRate
from echogrid.errors import EchogridError


def reader(profile: str, dbc: Path | None = None, radius: float | None = None) -> tuple[MotionReader, Health]:
    path = find(profile, Path())
    loaded = load_motion(path)
    health = Health()
    return MotionReader(loaded, Dbc(dbc or path.parent / str(loaded.dbc), path), Motion(bus="can0", wheel_radius=radius), health), health


def test_speed_and_yaw_rate_with_their_signs() -> None:
    motion, _ = reader("vehicle_motion")
    (forward,) = motion.add(wheel_speeds(7.5, 0, 1.0), 10)
    (backward,) = motion.add(wheel_speeds(-2.5, 1, 1.0), 20)
    (left,) = motion.add(yaw_rate(0.25, 0, 1.0), 30)
    assert forward == Speed(10, 7.5)
    assert backward == Speed(20, -2.5)
    assert left == YawRate(30, pytest.approx(0.25, abs=1e-4))


def test_an_unsound_frame_changes_nothing() -> None:
    motion, health = reader("vehicle_motion")
    motion.add(wheel_speeds(-5.0, 3, 1.0), 10)
    broken = wheel_speeds(8.0, 4, 1.0)
    broken.data[2] ^= 1
    for message, reason in ((broken, "checksum"), (wheel_speeds(8.0, 3, 1.0), "counter"), (frame(0x100, bytes(4), 1.0), "short")):
        with pytest.raises(ValueError, match=reason):
            motion.add(message, 20)
    assert motion.reverse
    (fine,) = motion.add(wheel_speeds(-6.0, 4, 1.0), 30)
    assert fine == Speed(30, -6.0)
    assert health.lost_frames == 0


def test_the_counter_says_how_many_frames_are_missing() -> None:
    motion, health = reader("vehicle_motion")
    for counter in (14, 15, 0, 3):
        motion.add(wheel_speeds(1.0, counter, 1.0), 10)
    assert health.lost_frames == 2


def test_toyota_wheel_speeds_equal_cantools(vendor_dbc: Callable[[str], Path]) -> None:
    path = vendor_dbc("toyota_nodsu_pt_generated")
    motion, _ = reader("toyota_motion", path)
    dbc = cantools.database.load_file(path, strict=False)
    random = np.random.default_rng(1)
    for payload in random.integers(0, 256, size=(50, 8), dtype=np.uint8):
        decoded = dbc.decode_message("WHEEL_SPEEDS", payload.tobytes())
        (speed,) = motion.add(frame(0xAA, payload.tobytes(), 1.0), 1)
        assert isinstance(speed, Speed)
        assert speed.speed == pytest.approx((decoded["WHEEL_SPEED_RL"] + decoded["WHEEL_SPEED_RR"]) / 2 / 3.6, abs=1e-9)
    decoded = dbc.decode_message("KINEMATICS", bytes(range(8)))
    (turn,) = motion.add(frame(0x24, bytes(range(8)), 1.0), 1)
    assert isinstance(turn, YawRate)
    assert turn.yaw_rate == pytest.approx(math.radians(decoded["YAW_RATE"]), abs=1e-9)


FORD = """
kind = "motion"
[wheel_speeds]
message = "WheelSpeed"
rear_left = { signal = "WhlRl_W_Meas", unit = "rad/s", valid = { signal = "WhlRl_W_Meas", none_of = [32766, 32767] } }
rear_right = { signal = "WhlRr_W_Meas", unit = "rad/s", valid = { signal = "WhlRr_W_Meas", none_of = [32766, 32767] } }
[yaw_rate]
message = "Yaw_Data_FD1"
yaw_rate = { signal = "VehYaw_W_Actl", unit = "rad/s" }
"""


def test_turn_rates_of_wheels_need_the_tyres_radius_and_sentinels_are_no_speeds(tmp_path: Path, vendor_dbc: Callable[[str], Path]) -> None:
    path = tmp_path / "ford.toml"
    path.write_text(FORD)
    dbc = Dbc(vendor_dbc("ford_lincoln_base_pt"), path)
    with pytest.raises(EchogridError, match="wheel_radius is missing"):
        MotionReader(load_motion(path), dbc, Motion(bus="can0"), Health())
    motion = MotionReader(load_motion(path), dbc, Motion(bus="can0", wheel_radius=0.33), Health())
    message = cantools.database.load_file(dbc.path, strict=False).get_message_by_name("WheelSpeed")
    rates = {signal.name: 0 for signal in message.signals} | {"WhlRl_W_Meas": 20.0, "WhlRr_W_Meas": 22.0}
    (speed,) = motion.add(frame(message.frame_id, message.encode(rates, strict=False), 1.0), 1)
    assert speed == Speed(1, pytest.approx(21 * 0.33), difference=pytest.approx(2 * 0.33))
    for raw in (32766, 32767):
        unknown = message.encode(rates | {"WhlRl_W_Meas": raw * 0.01}, strict=False)
        with pytest.raises(ValueError, match="invalid"):
            motion.add(frame(message.frame_id, unknown, 1.0), 2)
    with pytest.raises(EchogridError, match="wheel_radius is given"):
        reader("vehicle_motion", radius=0.3)


VW = """
kind = "motion"
[wheel_speeds]
message = "ESP_19"
rear_left = { signal = "ESP_HL_Radgeschw_02", unit = "km/h" }
rear_right = { signal = "ESP_HR_Radgeschw_02", unit = "km/h" }
[yaw_rate]
message = "ESP_02"
yaw_rate = { signal = "ESP_Gierrate", unit = "deg/s", negative_if = { signal = "ESP_VZ_Gierrate", one_of = [1] } }
counter = "COUNTER"
"""


def test_a_sign_bit_in_a_signal_of_its_own(tmp_path: Path, vendor_dbc: Callable[[str], Path]) -> None:
    path = tmp_path / "vw.toml"
    path.write_text(VW)
    motion = MotionReader(load_motion(path), Dbc(vendor_dbc("vw_mqb"), path), Motion(bus="can0"), Health())
    message = motion_message = cantools.database.load_file(vendor_dbc("vw_mqb"), strict=False).get_message_by_name("ESP_02")
    for counter, (bit, expected) in enumerate(((0, 12.5), (1, -12.5))):
        values = {signal.name: 0 for signal in message.signals} | {"ESP_Gierrate": 12.5, "ESP_VZ_Gierrate": bit, "COUNTER": counter}
        (turn,) = motion.add(frame(motion_message.frame_id, message.encode(values, strict=False), 1.0), 1)
        assert turn == YawRate(1, pytest.approx(math.radians(expected)))


def test_no_number_is_no_motion(tmp_path: Path) -> None:
    (tmp_path / "float.dbc").write_text(
        'BU_: T R\n\nBO_ 1 W: 8 T\n SG_ L : 0|32@1- (1,0) [0|0] "" R\n SG_ Q : 32|32@1- (1,0) [0|0] "" R\n\n'
        'BO_ 2 Y: 4 T\n SG_ Rate : 0|32@1- (1,0) [0|0] "" R\n\n'
        "SIG_VALTYPE_ 1 L : 1;\nSIG_VALTYPE_ 1 Q : 1;\nSIG_VALTYPE_ 2 Rate : 1;\n"
    )
    path = tmp_path / "float.toml"
    path.write_text(
        'kind = "motion"\n[wheel_speeds]\nmessage = "W"\nrear_left = { signal = "L", unit = "m/s" }\n'
        'rear_right = { signal = "Q", unit = "m/s" }\n'
        '[yaw_rate]\nmessage = "Y"\nyaw_rate = { signal = "Rate", unit = "rad/s" }\n'
    )
    motion = MotionReader(load_motion(path), Dbc(tmp_path / "float.dbc", path), Motion(bus="can0"), Health())
    assert motion.add(frame(1, np.array((2.0, 4.0), dtype="<f4").tobytes(), 1.0), 1) == [Speed(1, 3.0, difference=2.0)]
    for identifier, values in ((1, (2.0, math.nan)), (2, (math.nan,))):
        with pytest.raises(ValueError, match="invalid"):
            motion.add(frame(identifier, np.array(values, dtype="<f4").tobytes(), 1.0), 2)


@pytest.mark.parametrize("seed", range(6))
def test_a_loaded_machine_that_stamps_late_begins_no_new_map(seed: int) -> None:
    """Stalls of up to 0.4 s, after which all that waited comes at once: every sample continues those before."""
    motion, _ = reader("vehicle_motion")
    rng = np.random.default_rng(seed)
    wake, waited, samples = 0.0, 0, []
    for n in range(3000):
        while wake < n * 0.01:
            wake += rng.exponential(0.01) + (rng.uniform(0.05, 0.4) if rng.random() < 0.01 else 0.0)
            waited = 0
        waited += 1
        samples += motion.add(wheel_speeds(5.0, n % 16, 1.0), round((wake + waited * 3e-5) * 1e9))
    assert all(sample.continues for sample in samples)
    assert len(samples) > 2700


@given(st.floats(0.25, 0.6), st.integers(0, 15))
@settings(max_examples=30, deadline=None)
def test_time_that_jumps_and_stays_ahead_begins_one(jump: float, phase: int) -> None:
    """Told a quarter of a second later, until when there is no sample: it might have been a stall."""
    motion, _ = reader("vehicle_motion")
    for n in range(300):
        motion.add(wheel_speeds(5.0, (n + phase) % 16, 1.0), round(n * 1e7))
    after = [motion.add(wheel_speeds(5.0, (n + phase) % 16, 1.0), round(n * 1e7 + jump * 1e9)) for n in range(300, 360)]
    round_trip = abs(jump / 0.16 - round(jump / 0.16)) < 0.25  # a counter of four bits goes round in 0.16 s, and could have
    if not round_trip:
        first = next(n for n, samples in enumerate(after) if samples)
        assert first == 25
        assert not after[first][0].continues
        assert all(sample.continues for samples in after[first + 1 :] for sample in samples)
