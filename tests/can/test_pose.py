"""Poses from outside out of frames, encoded by cantools."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tests.support import posed
from tests.support.frames import CONFIG, wheel_speeds

from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.core.health import Health
from echogrid.core.messages import PoseFix
from echogrid.errors import EchogridError

POSE = '\n[pose]\nbus = "can0"\nprofile = "metres.toml"\n'
ON_EARTH = POSE.replace("metres", "earth") + "origin = [60.17, 24.94]\n"
MS = 1_000_000


def signals(folder: Path, pose: str) -> SignalReader:
    path = posed.write(folder) / "echogrid.toml"
    path.write_text(CONFIG + pose)
    return SignalReader(load_config(path), path, Health())


def test_place_and_yaw_of_one_frame(tmp_path: Path) -> None:
    reader = signals(tmp_path, POSE + "latency_ms = 20\n")
    (fix,) = reader.add("can0", posed.metres(1234.5, -67.25, -2.5, 0, 100.0))
    assert isinstance(fix, PoseFix)
    assert (fix.stamp_ns, fix.yaw_ns) == (99_980 * MS, 99_980 * MS)
    assert (fix.x, fix.y, fix.yaw) == pytest.approx((1234.5, -67.25, -2.5), abs=1e-4)
    assert reader.health.pose.invalid == 0


def test_a_frame_that_is_unsound_is_bad_and_one_without_a_fix_is_invalid(tmp_path: Path) -> None:
    """The sender says itself that it does not know: that is no fault of the bus."""
    reader = signals(tmp_path, POSE)
    broken = posed.metres(1.0, 2.0, 0.5, 1, 100.0)
    broken.data[0] ^= 1
    short = posed.metres(1.0, 2.0, 0.5, 2, 100.1)
    short.data = short.data[:8]
    for message in (broken, short, posed.metres(1.0, 2.0, 0.5, 3, 100.2, fix=1), posed.metres(2e6, 0.0, 0.5, 4, 100.3)):
        assert list(reader.add("can0", message)) == []
    assert (reader.health.bad_frames, reader.health.pose.invalid) == (2, 2)
    assert len(reader.add("can0", posed.metres(1.0, 2.0, 0.5, 5, 100.4))) == 1
    assert list(reader.add("can0", posed.metres(9.0, 2.0, 0.5, 5, 100.5))) == []  # a counter that stands
    assert reader.health.bad_frames == 3


def test_latitude_longitude_and_a_heading_of_its_own(tmp_path: Path) -> None:
    """A hundredth of a degree north at 60°: 1,114 m; a heading of 30° is a yaw of 60°, and meridians converge by less than 0.01°."""
    reader = signals(tmp_path, ON_EARTH)
    assert list(reader.add("can0", posed.satellites(60.18, 24.95, 99.9))) == []  # without a heading there is no pose
    assert list(reader.add("can0", posed.course(30.0, 100.0))) == []
    (fix,) = reader.add("can0", posed.satellites(60.18, 24.95, 100.1))
    assert isinstance(fix, PoseFix)
    assert (fix.stamp_ns, fix.yaw_ns) == (100_070 * MS, 99_990 * MS)
    assert (fix.x, fix.y) == pytest.approx((0.01 * 111_412 * math.cos(math.radians(60.18)) * 1.0026, 1114.2), abs=4.0)
    assert fix.yaw == pytest.approx(math.radians(60.0), abs=2e-4)
    assert list(reader.add("can0", posed.satellites(60.18, 24.95, 100.7))) == []  # the heading is too old by now
    reader.add("can0", posed.course(200.0, 100.7))
    assert list(reader.add("can0", posed.satellites(0.0, 0.0, 100.8))) == []  # what receivers say that know nothing
    assert list(reader.add("can0", posed.satellites(-60.17, 24.94, 100.9))) == []
    assert reader.health.pose.invalid == 2


@pytest.mark.parametrize(
    ("pose", "profile", "expected"),
    [
        ("[pose]\n", "", "pose: neither bus and key found, expected one: a CAN bus, or a key of Zenoh"),
        (POSE + 'key = "ins/odom"\n', "", "pose: both bus and key found, expected one"),
        ('[pose]\nbus = "can0"\n', "", "pose.profile: is missing, expected the path of a profile that ends in .toml"),
        (POSE.replace("can0", "can1"), "", "pose.bus: no [[bus]] is named 'can1', found can0; did you mean 'can0'?"),
        (POSE + "origin = [60.17, 24.94]\n", "", "pose.origin is given, but"),
        (ON_EARTH.replace("60.17", "91"), "", "pose.origin[0]: 91 found, expected a number <= 90.0"),
        (ON_EARTH.split("origin")[0], "", "pose.origin is missing:"),
        (POSE + "orign = [60.17, 24.94]\n", "", "pose: unknown key 'orign'; did you mean 'origin'?"),
        (POSE + 'senders = ["ins"]\n', "", "pose.senders: found beside bus, expected beside key: CAN has no certificates"),
        ('[pose]\nkey = "ins/odom"\norigin = [60.0, 24.0]\n', "", "pose.origin: found beside key, expected beside bus"),
        ('[pose]\nkey = "ins/odom"\nsenders = ["ins"]\n', "", "pose.senders: found without [publish.tls], expected with it"),
        (POSE, "", ""),
        (POSE, METRES_BAD := "kind", "metres.toml: "),
        (POSE.replace("metres.toml", "metre.toml"), "", "metre.toml: "),
        (POSE, 'signal = "Yaww"', "message 'Place' of"),
        (POSE, 'unit = "deg" }', "yaw is a angle"),
    ],
)
def test_what_is_wrong_with_the_table_is_one_sentence(tmp_path: Path, pose: str, profile: str, expected: str) -> None:
    posed.write(tmp_path)
    text = posed.METRES
    if profile == METRES_BAD:
        text = text.replace('kind = "pose"', 'kind = "motion"')
    elif profile.startswith("signal"):
        text = text.replace('signal = "Yaw"', profile)
    elif profile:
        text = text.replace('"Yaw", unit = "rad" }', '"Yaw", unit = "m" }')
    (tmp_path / "metres.toml").write_text(text)
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG + "\n" + pose)
    if not expected:
        SignalReader(load_config(path), path, Health())
        return
    with pytest.raises(EchogridError) as caught:
        SignalReader(load_config(path), path, Health())
    assert str(path) in str(caught.value)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('y = { signal = "Y", unit = "m" }\n', "", "needs either x and y, or latitude and longitude"),
        ("[heading]\n", '[heading]\nmessage = "Place"\n', "heading.message is the place's, 'Place'; expected none, or another"),
        ("[heading]\n", "[heading]\nlatency_ms = 5\n", "expected with a message of its own: the place's are those of both"),
        ("[place]\n", '[place]\nlatitude = { signal = "X", unit = "deg" }\n', "needs either x and y, or latitude and longitude"),
    ],
)
def test_what_is_wrong_with_a_profile_is_one_sentence(tmp_path: Path, old: str, new: str, expected: str) -> None:
    posed.write(tmp_path)
    assert old in posed.METRES
    (tmp_path / "metres.toml").write_text(posed.METRES.replace(old, new))
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG + POSE)
    with pytest.raises(EchogridError, match=expected):
        SignalReader(load_config(path), path, Health())


def test_an_id_that_motion_reads_too_is_refused(tmp_path: Path) -> None:
    posed.write(tmp_path)
    (tmp_path / "pose.dbc").write_text(posed.DBC.replace("BO_ 512 ", f"BO_ {wheel_speeds(0.0, 0, 0.0).arbitration_id} "))
    path = tmp_path / "echogrid.toml"
    path.write_text(CONFIG + POSE)
    with pytest.raises(EchogridError, match="'motion' and 'pose' both read id 0x100 on bus 'can0'"):
        SignalReader(load_config(path), path, Health())
