"""Wrong conventions of a pose from outside are named, and mended so that the next check is content; a sound one is not accused."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import can
import numpy as np
import pytest

from echogrid.can.intake.frames import FrameBatch
from echogrid.commands.judged import check_log
from echogrid.commands.mended import write_mended
from echogrid.config.editing import edited
from echogrid.config.loading import load_config
from echogrid.core.motion.pose_convention import convention
from echogrid.core.motion.se2 import SE2
from echogrid.judging.finding import Finding, Undecided
from echogrid.judging.listening import Listener
from echogrid.judging.mending import Fix
from tests.support import posed, world
from tests.support.frames import wheel_speeds, yaw_rate

ORIGIN, TURNED = (60.17, 24.94), 0.7  # where the drive begins, and where it shows: rad
METRES = '\n[pose]\nbus = "can0"\nprofile = "metres.toml"\nx = 1.2\n'
EARTH = f'\n[pose]\nbus = "can0"\nprofile = "earth.toml"\norigin = {list(ORIGIN)}\nx = 1.2\n'
YAW = 'yaw = { signal = "Yaw", unit = "rad" }'
HEADING = 'unit = "deg", sign = -1, offset = 1.5707963267948966'
SIGNALS = ('"Latitude", unit', '"Longitude", unit')
Said = tuple[list[tuple[Finding, Fix]], list[Undecided]]


@cache
def driven(bends: float = 0.3) -> tuple[tuple[can.Message, ...], tuple[tuple[float, float, float, float], ...]]:
    """Motion's frames of 20 s that wind at 5 to 9 m/s; and, ten times a second, s, m east and north of the receiver, and rad."""
    time = np.arange(0.0, 20.0, 0.02)
    speed, rate = 7.0 + 2.0 * np.sin(0.3 * time), bends * np.sin(0.25 * time)
    yaw = TURNED + np.cumsum(rate) * 0.02
    place = np.cumsum(speed * np.exp(1j * yaw)) * 0.02 + 1.2 * np.exp(1j * yaw)
    frames = [
        frame
        for n, (at, v, w) in enumerate(zip(time, speed, rate, strict=True))
        for frame in (wheel_speeds(float(v), n, 100 + at), yaw_rate(float(w), n, 100 + at + 0.001))
    ]
    rows = zip(time[4::5].tolist(), place.real[4::5].tolist(), place.imag[4::5].tolist(), yaw[4::5].tolist(), strict=True)
    return tuple(frames), tuple(rows)


@cache
def poses(bends: float = 0.3, earth: bool = False) -> tuple[can.Message, ...]:
    """The receiver's frames, off by 0.3 m and 0.5° (one sigma)."""
    random, found = np.random.default_rng(3), list[can.Message]()
    for n, (at, x, y, yaw) in enumerate(driven(bends)[1]):
        x, y, yaw = x + random.normal(0.0, 0.3), y + random.normal(0.0, 0.3), yaw + random.normal(0.0, 0.009)
        if not earth:
            found.append(posed.metres(x, y, math.remainder(yaw, math.tau), n, 100 + at))
            continue
        metres_per_degree = 111_320.0
        longitude = ORIGIN[1] + x / (metres_per_degree * math.cos(math.radians(ORIGIN[0])))
        found.append(posed.course(math.degrees(math.pi / 2 - yaw) % 360.0, 100 + at + 0.01))
        found.append(posed.satellites(ORIGIN[0] + y / metres_per_degree, longitude, 100 + at + 0.03))
    return tuple(found)


def check(folder: Path, config: str, bends: float = 0.3) -> Said:
    """What is said of the pose; the profiles are in the folder."""
    messages = [*driven(bends)[0], *poses(bends, "earth" in config)]
    source = folder / "echogrid.toml"
    source.write_text(world.CONFIG + config)
    listener = Listener(load_config(source), source)
    listener.take(FrameBatch.of(sorted(messages, key=lambda message: message.timestamp)))
    judgement, findings, mender = listener.judged()
    said = [(finding, mender.fix(finding)) for finding in findings if finding.subject == "pose"]
    return said, [one for one in judgement.undecided if one.sentence.startswith("pose")]


def change(folder: Path, name: str, *changes: tuple[str, str]) -> None:
    text = (folder / name).read_text()
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    (folder / name).write_text(text)


@pytest.mark.parametrize("config", [METRES, EARTH], ids=["metres", "earth"])
@pytest.mark.parametrize("bends", [0.3, 0.0])
def test_a_sound_pose_is_not_accused(tmp_path: Path, config: str, bends: float) -> None:
    assert check(posed.write(tmp_path), config, bends) == ([], [])


@pytest.mark.parametrize(
    ("code", "config", "changes"),
    [
        ("pose_heading_sign", EARTH, [(HEADING, 'unit = "deg"')]),
        ("pose_heading_sign", METRES, [(YAW, 'yaw = { signal = "Yaw", unit = "rad", sign = -1 }')]),
        ("pose_heading_unit", EARTH, [(HEADING, HEADING.replace("deg", "rad"))]),
        ("pose_heading_unit", METRES, [(YAW, YAW.replace("rad", "deg"))]),
        ("pose_heading_offset", EARTH, [(HEADING, HEADING.replace("1.5707963267948966", "0.0"))]),
        ("pose_heading_offset", METRES + "yaw_deg = 180\n", []),
        ("pose_heading_offset", METRES + "yaw_deg = -90\n", []),
        ("pose_heading_offset", METRES + "yaw_deg = 25\n", []),
    ],
)
def test_a_wrong_heading_is_named_and_mended(tmp_path: Path, code: str, config: str, changes: list[tuple[str, str]]) -> None:
    """As the fix says, and then nothing is found any more."""
    profile = "earth.toml" if "earth" in config else "metres.toml"
    change(posed.write(tmp_path), profile, *changes)
    said, undecided = check(tmp_path, config)
    assert [finding.code for finding, _ in said] == [code]
    assert undecided == []
    fix = said[0][1]
    if "pose" in fix.profiles:
        (tmp_path / profile).write_text(edited((tmp_path / profile).read_text(), fix.profiles["pose"]))
    (tmp_path / "mended.toml").write_text(edited(world.CONFIG + config, fix.config))
    assert check(tmp_path, (tmp_path / "mended.toml").read_text().removeprefix(world.CONFIG)) == ([], [])


@pytest.mark.parametrize(
    ("code", "config", "changes"),
    [
        ("pose_mirrored", METRES, [('x = { signal = "X"', 'x = { signal = "Y"'), ('y = { signal = "Y"', 'y = { signal = "X"')]),
        ("pose_mirrored", METRES, [('"Y", unit = "m"', '"Y", unit = "m", sign = -1')]),
        ("pose_swapped", EARTH, [(SIGNALS[0], "?"), SIGNALS[::-1], ("?", SIGNALS[1])]),
        ("pose_mirrored", EARTH.replace(str(list(ORIGIN)), str(list(ORIGIN[::-1]))), [(SIGNALS[0], "?"), SIGNALS[::-1], ("?", SIGNALS[1])]),
    ],
)
def test_swapped_axes_are_named(tmp_path: Path, code: str, config: str, changes: list[tuple[str, str]]) -> None:
    change(posed.write(tmp_path), "earth.toml" if "earth" in config else "metres.toml", *changes)
    said, _ = check(tmp_path, config)
    assert [(finding.code, bool(fix.says)) for finding, fix in said] == [(code, True)]


def test_straight_on_it_is_not_known_what_is_wrong(tmp_path: Path) -> None:
    said, undecided = check(posed.write(tmp_path), METRES + "yaw_deg = 90\n", 0.0)
    assert said == []
    assert [one.code for one in undecided] == ["needs_turn"]
    assert "90° off" in undecided[0].sentence


def test_a_pose_over_zenoh_is_said_not_to_be_judged(tmp_path: Path) -> None:
    """No recording of CAN shows it, whatever the profile of another pose would say."""
    said, undecided = check(posed.write(tmp_path), '\n[pose]\nkey = "ins/odom"\n')
    assert said == []
    assert [one.code for one in undecided] == ["needs_can_pose"]
    assert "ins/odom" in undecided[0].sentence


def test_dead_reckoning_that_drifts_accuses_no_pose() -> None:
    """A gyro that shows 0.5 °/s too much for ten minutes; then one with the wrong sign: places and headings go the other way round."""
    time = np.arange(0.0, 600.0, 0.1)
    rate = 0.1 * np.sin(0.1 * time)
    yaw = np.cumsum(rate) * 0.1
    place = np.cumsum(8.0 * np.exp(1j * yaw)) * 0.1
    told = np.stack((time, place.real, place.imag, time, yaw), axis=1)
    drifting = convention(np.stack((time, np.full_like(time, 8.0), rate + math.radians(0.5)), axis=1), told, SE2(0.0, 0.0, 0.0))
    assert drifting is not None
    assert (drifting.mirrored, drifting.factor) == (False, 1.0)
    assert drifting.as_told < math.radians(5.0)
    mirrored = convention(np.stack((time, np.full_like(time, 8.0), -rate), axis=1), told, SE2(0.0, 0.0, 0.0))
    assert mirrored is not None
    assert mirrored.mirrored


def test_the_mended_files_are_written_beside_one_another(tmp_path: Path) -> None:
    """Into another folder: the pose's own profile is changed, and its DBC is found from there."""
    change(posed.write(tmp_path), "earth.toml", (HEADING, 'unit = "deg"'))
    world.write_drive(tmp_path, sorted([*driven()[0], *poses(earth=True)], key=lambda message: message.timestamp), world.CONFIG + EARTH)
    (tmp_path / "out").mkdir()
    mended = tmp_path / "out" / "mended.toml"
    report = check_log(load_config(tmp_path / "echogrid.toml"), tmp_path / "echogrid.toml", tmp_path / "can.log")
    write_mended(report, tmp_path / "echogrid.toml", mended, force=False)
    again = check_log(load_config(mended), mended, tmp_path / "can.log")
    assert [one.code for one in report.findings if one.subject == "pose"] == ["pose_heading_sign"]
    assert not [one for one in again.findings if one.subject == "pose"]
