"""Classic mistakes are named with the right code and mended by the right line; sound drives are not accused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from echogrid.can.intake.frames import FrameBatch
from echogrid.config.loading import load_config
from echogrid.core.messages import RadarScan, Speed, YawRate
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.judging.finding import CODES
from echogrid.judging.judge import judge
from echogrid.judging.listening import Listener
from echogrid.judging.mending import SAYS, Mender
from echogrid.judging.recorded import collect
from echogrid.judging.sensor_velocity import sensor_velocity
from tests.judging.mistakes import PLANTED, Mistake, Planted
from tests.judging.trial import check, found, mended, others, shipped, winding
from tests.support import world

DRIVES = {"winding": winding, "shipped": lambda: shipped(18.0, 24.0)}
CAUSED = {"frames lost": {"silence"}}  # what may be said besides


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("mistake", PLANTED, ids=lambda mistake: mistake.name)
def test_a_planted_mistake(mistake: Mistake, drive: str) -> None:
    sound = DRIVES[drive]()
    said = check(mistake.plant(sound))
    told = [(finding.code, finding.sentence, fix) for finding, fix in said]
    assert found(mistake, said), told
    assert mended(mistake, sound, said), told
    assert set(others(mistake, said)) <= CAUSED.get(mistake.name, set()), told


@pytest.mark.parametrize("sound", [winding, shipped], ids=["winding", "shipped"])
def test_sound_drives_are_not_accused(sound: object) -> None:
    assert callable(sound)
    assert check(sound()) == []


@pytest.mark.parametrize("seconds", [4.0, 7.0, 9.7, 12.0])
@pytest.mark.parametrize("first", [0.0, 21.0, 42.0])
def test_nor_are_seconds_of_a_sound_drive(first: float, seconds: float) -> None:
    """Too little to know a wheel's scale from the yaws of the mounts: it is not judged."""
    assert check(shipped(first, seconds)) == []


def test_every_code_has_its_words_and_every_fix_a_code() -> None:
    """A misspelt method of Mender would never be called."""
    fixes = {name[1:] for name in vars(Mender) if name.startswith("_") and name[1:].islower() and not name.startswith("__")}
    helpers = {"index", "buses", "motion_signs", "signs", "units", "quantities", "swapped"}
    assert fixes - helpers <= set(CODES)
    assert set(SAYS) - {"scale"} <= set(CODES)
    assert {mistake.code for mistake in PLANTED} <= set(CODES)


MOUNTS = {
    "front_left": Mount(SE2(3.6, 0.8, math.radians(45)), math.radians(75), 25.0),
    "rear_right": Mount(SE2(-0.8, -0.8, math.radians(-135)), math.radians(75), 25.0),
}


def synthetic(seconds: float, speed: float, turn: float, random: np.random.Generator) -> tuple[list[Speed | YawRate], list[RadarScan]]:
    """Radars that see what stands anywhere, one detection in five a mover: range rate = -u . v, v as a rigid body has it at the mount."""
    motion: list[Speed | YawRate] = []
    scans = []
    for n in range(round(seconds * 50)):
        stamp = n * 20_000_000
        rate = turn * math.sin(0.02 * n * 0.8)
        motion += [Speed(stamp, speed), YawRate(stamp, rate)]
        for name, mount in MOUNTS.items():
            place = mount.base_from_sensor
            azimuth = random.uniform(-1.2, 1.2, 24)
            toward = np.stack((np.cos(azimuth + place.yaw), np.sin(azimuth + place.yaw)))
            velocity = np.array((speed - rate * place.y, rate * place.x))
            seen = -velocity @ toward + random.normal(0.0, 0.08, 24) + np.where(random.random(24) < 0.2, random.uniform(-9, 9, 24), 0.0)
            range_ = random.uniform(2, 20, 24)
            scans.append(RadarScan(name, stamp, stamp, range_, azimuth, seen, np.full(24, np.nan)))
    return motion, scans


def test_a_scan_tells_how_its_radar_moved() -> None:
    """Against the velocity that the range rates were made from, with a fifth of gross errors."""
    motion, scans = synthetic(6.0, 7.0, 0.3, np.random.default_rng(3))
    recorded = collect(motion, scans, MOUNTS)
    for radar in recorded.radars:
        seen = sensor_velocity(radar)
        assert len(seen) > 0.95 * len(radar)
        rate = recorded.yaw_rate.at(seen.time)
        place = radar.mount.base_from_sensor
        true = ((7.0 - rate * place.y) + 1j * rate * place.x) * np.exp(-1j * place.yaw)
        error = np.abs(seen.velocity - true)
        assert np.median(error) < 0.06
        assert np.percentile(error, 95) < 0.2


def test_what_the_drive_does_not_tell_is_said() -> None:
    """Straight and steady: no word on signs, and which manoeuvres are missing; slow: none on anything."""
    straight = judge(collect(*synthetic(8.0, 6.0, 0.0, np.random.default_rng(4)), MOUNTS), dict.fromkeys(MOUNTS, "p"))
    assert straight.findings == ()
    assert {"needs_turn", "needs_stop", "needs_acceleration"} <= {one.code for one in straight.undecided}
    slow = judge(collect(*synthetic(8.0, 0.1, 0.0, np.random.default_rng(4)), MOUNTS), dict.fromkeys(MOUNTS, "p"))
    assert slow.findings == ()
    assert [one.code for one in slow.undecided].count("needs_speed") == len(MOUNTS)


def test_few_detections_among_ghosts_are_not_called_garbled() -> None:
    """Seven in a scan, most of them anything: too little to say that the values are none."""
    random = np.random.default_rng(6)
    motion, scans = synthetic(12.0, 6.0, 0.2, random)
    thinned = [
        structs.replace(
            scan,
            range=scan.range[:7],
            azimuth=scan.azimuth[:7],
            rcs=scan.rcs[:7],
            range_rate=np.where(random.random(7) < 0.7, random.uniform(-25, 25, 7), scan.range_rate[:7]),
        )
        for scan in scans
    ]
    assert judge(collect(motion, thinned, MOUNTS), dict.fromkeys(MOUNTS, "p")).findings == ()


def test_an_empty_recording_is_judged_without_a_word_on_values() -> None:
    nothing = judge(collect([], [], MOUNTS), dict.fromkeys(MOUNTS, "p"))
    assert nothing.findings == ()


def test_one_cause_is_found_rather_than_four() -> None:
    """All radars mirrored: nobody is told to turn four mounts, or that the wheels or the yaw rate are wrong."""
    mistake = next(one for one in PLANTED if one.code == "azimuth_sign" and len(one.radars) == 4)
    assert [finding.code for finding, _ in check(mistake.plant(winding()))] == ["azimuth_sign"]


def planted(name: str) -> Planted:
    return next(one for one in PLANTED if one.name == name).plant(winding())


def test_two_mistakes_at_once() -> None:
    """Found together, each with its own line."""
    both = planted("azimuth's sign").radar(1, yaw_deg=-45.0 + 6.0)
    said = {finding.code: fix for finding, fix in check(both)}
    assert set(said) == {"azimuth_sign", "mount_yaw"}
    assert said["mount_yaw"].config["radar", 1, "yaw_deg"] == pytest.approx(-45.0, abs=0.5)


def test_rear_wheels_with_each_others_signal_are_mended() -> None:
    """They differ in the shipped drive, where the other drive's are one."""
    both = r'(rear_left = \{ signal = )"WheelSpeedRL"(.*\nrear_right = \{ signal = )"WheelSpeedRR"'
    swapped = shipped(18.0, 24.0).motion_profile(both, r'\1"WheelSpeedRR"\2"WheelSpeedRL"')
    ((finding, fix),) = check(swapped)
    assert finding.code == "wheels_swapped"
    signals = {("wheel_speeds", f"rear_{side}", "signal"): f"WheelSpeedR{side[0].upper()}" for side in ("left", "right")}
    assert (fix.config, fix.profiles) == ({}, {"motion": signals})


def test_a_pause_of_the_recording_accuses_nobody(tmp_path: Path) -> None:
    """All are silent at once: none is silent or has lost scans for itself, and what is before and after is as far apart as it was."""
    (tmp_path / "echogrid.toml").write_text(world.CONFIG)
    messages = world.record(world.straight(6.0), [world.standing([(9.0, 3.0)])], 12.0)
    for message in messages:
        message.timestamp += 300.0 * (message.timestamp > 106.0)
    listener = Listener(load_config(tmp_path / "echogrid.toml"), tmp_path / "echogrid.toml")
    listener.take(FrameBatch.of(messages))
    silent = [(one.subject, one.radars) for one in listener.judged()[1] if one.code in ("silence", "lost_frames")]
    assert silent == [("recording", ())]
    recorded = listener.recorded()
    assert recorded.pauses[:, 1] - recorded.pauses[:, 0] == pytest.approx([300.0], abs=0.1)
    assert recorded.steps(recorded.speed.time) == pytest.approx(0.01, abs=0.012)
