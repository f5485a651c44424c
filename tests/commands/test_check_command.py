"""`echogrid check` as it is typed: exit codes, JSON, the mended configuration, the page."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import can
import pytest
from tests.judging.mistakes import PLANTED, Planted
from tests.judging.trial import winding
from tests.support.program import echogrid

from echogrid.config.loading import remarks
from echogrid.config.tables import Bus, Config, Motion, Pose, Radar
from echogrid.judging.finding import CODES


def written(folder: Path, planted: Planted) -> tuple[Path, Path]:
    """Configuration and log."""
    folder.mkdir(exist_ok=True)
    with can.CanutilsLogWriter(folder / "can.log") as writer:
        for message in planted.messages:
            writer.on_message_received(message)
    return planted.write(folder), folder / "can.log"


@pytest.fixture(scope="module")
def mirrored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A comment in the configuration, azimuths of the wrong sign, and a yaw that is off."""
    mistake = next(one for one in PLANTED if one.name == "azimuth's sign").plant(winding())
    planted = mistake.radar(2, yaw_deg=141.0).sub(r'vehicle = "test"', 'vehicle = "test"  # ours')
    return written(tmp_path_factory.mktemp("mirrored"), planted)


def test_a_sound_drive_exits_with_0(tmp_path: Path) -> None:
    config, log = written(tmp_path, winding())
    done = echogrid("check", "-c", config, log)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("nothing wrong was found\n")
    done = echogrid("check", "-c", config)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("option", ["--report", "--fix-out"])
def test_what_is_there_is_replaced_by_force_alone(option: str, tmp_path: Path) -> None:
    """And the recording is not gone through first."""
    config, log = written(tmp_path, winding())
    there = tmp_path / {"--report": "there.html", "--fix-out": "there.toml"}[option]
    there.write_text("mine")
    done = echogrid("check", "-c", config, tmp_path / "nowhere.log", option, there)
    assert (done.returncode, there.read_text()) == (1, "mine")
    assert done.stderr == f"echogrid: {there}: is there already; give another {option}, or --force to replace it\n"
    assert echogrid("check", "-c", config, log, option, there, "--force").returncode == 0
    assert there.read_text() != "mine"


def test_a_bus_that_nothing_is_on_is_a_remark_and_no_mistake(tmp_path: Path) -> None:
    """With a recording and without, in words and as JSON."""
    config, log = written(tmp_path, winding())
    config.write_text(config.read_text() + '\n[[bus]]\nname = "body"\nchannel = "can5"\n')
    for given in ((), (log,)):
        done = echogrid("check", "-c", config, *given)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.count("bus 'body': no radar, no [motion] and no [pose] is on it, so a service does not open it\n") == 1
        assert json.loads(echogrid("check", "-c", config, *given, "--json").stdout)["unread_buses"] == ["body"]


@pytest.mark.parametrize("table", ["motion", "radar", "pose"])
def test_a_bus_that_something_is_on_is_read(table: str) -> None:
    buses = {one: f"of {one}" for one in ("motion", "radar", "pose")}
    config = Config(
        bus=tuple(Bus(name=name) for name in buses.values()),
        motion=Motion(bus=buses["motion"]),
        radar=(Radar(name="front", bus=buses["radar"], x=0.0, y=0.0, yaw_deg=0.0),),
        pose=Pose(bus=buses["pose"], profile="pose.toml"),
    )
    assert buses[table] in [bus.name for bus in config.read_buses]
    assert not remarks(config)


def test_what_is_mended_is_sound(mirrored: tuple[Path, Path], tmp_path: Path) -> None:
    """The mended configuration in another folder, with its own copy of the profile: nothing is found any more."""
    config, log = mirrored
    wanted = "check", "-c", config, log, "--json", "--fix-out", tmp_path / "mended.toml", "--report", tmp_path / "page.html"
    profile = tmp_path / "mended_own_radar.toml"
    profile.write_text("mine")
    done = echogrid(*wanted)
    assert (done.returncode, profile.read_text(), [path.name for path in tmp_path.iterdir()]) == (1, "mine", [profile.name])
    assert done.stderr == f"echogrid: {profile}: is there already; give another --fix-out, or --force to replace it\n"
    done = echogrid(*wanted, "--force")
    assert (done.returncode, done.stderr) == (2, "")
    told = json.loads(done.stdout)
    assert {one["code"] for one in told["findings"]} == {"azimuth_sign", "mount_yaw"}
    assert all(one["code"] in CODES and 0.5 < one["confidence"] <= 1 and one["fix"] for one in told["findings"])
    assert set(told["radars"]["front_left"]) >= {"rate_hz", "gap_s", "jitter_ms", "bad_crc", "range_m", "estimates"}
    assert told["radars"]["front_left"]["rate_hz"] == pytest.approx(20.0, abs=0.1)
    text = (tmp_path / "mended.toml").read_text()
    assert 'vehicle = "test"  # ours' in text
    done = echogrid("check", "-c", tmp_path / "mended.toml", log, "--report", tmp_path / "again.html")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert done.stdout.endswith(f"written: {tmp_path / 'again.html'}\n")
    check_page((tmp_path / "page.html").read_text())


def check_page(text: str) -> None:
    """One page that needs nothing else."""
    tags: list[tuple[str, dict[str, str | None]]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            tags.append((tag, dict(attrs)))

    Reader().feed(text)
    assert not [tag for tag, _ in tags if tag in ("script", "link", "img", "iframe")]
    assert not [found for _, found in tags if "src" in found or "href" in found]
    assert len([tag for tag, _ in tags if tag == "svg"]) == 12  # speed, gaps, counts, map; residuals and sectors of four radars
    named = re.findall(r'fill="(#\w+)">(\w+)</text>', text)
    assert len(set(named)) == len({name for _, name in named}), "a radar has the same colour in all plots"
    assert "azimuth_sign" in text
    assert ">-0<" not in text
    assert "nan" not in text.lower().replace("nanoseconds", "")


def test_what_cannot_be_read_is_one_sentence(mirrored: tuple[Path, Path], tmp_path: Path) -> None:
    config, log = mirrored
    for arguments, said in (
        (("-c", config, tmp_path / "none.log"), "none.log"),
        (("-c", tmp_path / "none.toml", tmp_path / "none.log"), "none.toml"),
        (("-c", config, "--report", "a.html"), "--fix-out and --report need a LOG"),
        (("-c", config, log, "--fix-out", config), f"{config}: is there already; give another --fix-out, or --force to replace it"),
    ):
        done = echogrid("check", *arguments)
        assert done.returncode == 1
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
