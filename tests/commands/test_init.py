"""From nothing to the right configuration: cars of our own making, with DBC files of their own, in three log formats."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.commands.test_check_command import written
from tests.judging.trial import winding
from tests.support.frames import radar_cycle
from tests.support.own_cars import CARS
from tests.support.places import DBC, ROOT
from tests.support.program import echogrid
from tests.support.world import RADARS

from echogrid.can.dbc import Dbc
from echogrid.commands.init import _unused
from echogrid.commands.replay import replay
from echogrid.logs.drive import find_drive
from echogrid.surveying.heard import Heard
from echogrid.surveying.senders import Source

RIGHT: dict[str, set[tuple[int, int]]] = {}  # by car, the map of the configuration written by hand; the same from every format


def settled(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text())


def occupied(log: Path, config: Path, out: Path) -> set[tuple[int, int]]:
    """Cells of the map, by their place."""
    replay(find_drive(log, config), out, model="analytic")
    with np.load(out / "map.npz") as file:
        rows, columns = np.nonzero(file["log_odds"] > 0.5)
        first = np.rint(file["origin"] / file["cell"]).astype(int)
    return {(int(x + first[0]), int(y + first[1])) for x, y in zip(columns, rows, strict=True)}


@pytest.mark.parametrize(
    ("car", "name"),
    [("falcon", "drive.blf"), ("falcon", "drive.asc"), ("falcon", "drive.log"), ("heron", "drive.asc"), ("stork", "drive.log")],
)
def test_init_alone_gives_the_right_configuration(car: str, name: str, tmp_path: Path) -> None:
    """Mounts within half a degree and 0.3 m, `check` accepts it, and the map is that of the configuration written by hand."""
    log, dbc, right = CARS[car].write(tmp_path, name)
    done = echogrid("init", log, "--dbc", dbc, "--out", tmp_path / "new.toml")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    found = {radar["name"]: radar for radar in settled(tmp_path / "new.toml")["radar"]}
    assert set(found) == set(RADARS)
    for radar, (x, y, yaw) in RADARS.items():
        assert found[radar]["yaw_deg"] == pytest.approx(yaw, abs=0.5)
        assert (found[radar]["x"], found[radar]["y"]) == pytest.approx((x, y), abs=0.3)
    done = echogrid("check", "-c", tmp_path / "new.toml", log)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    if car not in RIGHT:
        RIGHT[car] = occupied(log, right, tmp_path / "right")
    ours, theirs = occupied(log, tmp_path / "new.toml", tmp_path / "ours"), RIGHT[car]
    assert len(theirs) > 1000
    assert len(ours & theirs) > 0.9 * len(ours | theirs)


def test_what_is_uncertain_is_marked_at_its_line_and_told(tmp_path: Path) -> None:
    """The stork's DBC says no sides: left and right may be mirrored, and the first bend tells a person which."""
    log, dbc, _ = CARS["stork"].write(tmp_path, "drive.log")
    done = echogrid("init", log, "--dbc", dbc, "--out", tmp_path / "new.toml")
    assert done.returncode == 0
    text = (tmp_path / "new.toml").read_text()
    lines = [line for line in text.splitlines() if line.startswith(("x =", "y =", "yaw_deg =", "wheel_radius ="))]
    assert len(lines) == 13
    assert all("  # uncertain: " in line for line in lines)
    assert settled(tmp_path / "new.toml")["motion"]["wheel_radius"] == pytest.approx(0.34, rel=0.01)
    assert "left and right: by this configuration the first bend is at 6 s, " in done.stdout
    assert "to the right." in done.stdout  # as the winding drive goes: its turn rate is sin(0.55 t) from 5 s on, negative from 5.7 s on


def test_no_dbc_is_needed_where_a_shipped_profile_fits(tmp_path: Path) -> None:
    _, log = written(tmp_path, winding())
    done = echogrid("init", log, "--out", tmp_path / "new.toml")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    new = settled(tmp_path / "new.toml")
    assert new["motion"]["profile"] == "vehicle_motion"
    assert [(radar["profile"], radar["id_offset"]) for radar in new["radar"]] == [("corner_radar", 16 * n) for n in range(4)]
    assert sorted(path.name for path in tmp_path.glob("*.toml")) == ["echogrid.toml", "new.toml"]


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    """Radars alone: without ego motion there is no configuration yet, but the profile is there, and exit code 2."""
    log, dbc, _ = CARS["heron"].write(tmp_path, "drive.log")
    lines = [line for line in log.read_text().splitlines(keepends=True) if "can0" not in line]
    log.write_text("".join(lines))
    done = echogrid("init", log, "--dbc", dbc, "--out", tmp_path / "new.toml")
    assert (done.returncode, done.stderr) == (2, "")
    assert "missing: wheel speeds and yaw rate: the DBC has signals like them, but the recording has no frames that fit" in done.stdout
    assert "# missing: wheel speeds and yaw rate" in (tmp_path / "new.toml").read_text()
    profile = settled(tmp_path / "new_radar.toml")
    assert profile["detections"]["messages"] == "CR_Obj_{n:02d}"
    assert profile["detections"]["azimuth"]["signal"] == "Obj{n:02d}_Phi"
    skeleton = settled(tmp_path / "new_motion.toml")
    assert skeleton["wheel_speeds"]["rear_left"] == {"signal": "RearLeftWheel_Speed", "unit": "m/s"}
    assert skeleton["yaw_rate"]["yaw_rate"] == {"signal": "GyroZ", "unit": "rad/s"}


def test_a_drive_without_bends_marks_what_it_does_not_tell(tmp_path: Path) -> None:
    """The first 6 s of the drawn drive: 5 of them the car stands."""
    _, log = written(tmp_path, winding())
    short = tmp_path / "short.log"
    short.write_text("".join(line for line in log.read_text().splitlines(keepends=True) if float(line[1:].split(")")[0]) < 104.0))
    done = echogrid("init", short, "--out", tmp_path / "new.toml")
    assert "not judged [needs_speed]" in done.stdout
    text = (tmp_path / "new.toml").read_text()
    assert text.count("a guess: no Doppler tells it") == 4
    assert done.returncode == 0


def test_what_is_there_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "new.toml").write_text("mine")
    done = echogrid("init", tmp_path / "any.log", "--out", tmp_path / "new.toml")
    assert done.returncode == 1
    assert done.stderr == f"echogrid: {tmp_path / 'new.toml'}: is there already; give another --out, or --force to replace it\n"
    assert (tmp_path / "new.toml").read_text() == "mine"


def test_a_dbc_that_nothing_was_read_by_is_told(tmp_path: Path) -> None:
    """That of another car, and one whose messages the recording has, but a shipped profile reads them; not one that a profile names,
    by whatever way it was given, and not for that one of its name in another folder."""
    heard = Heard()
    for message in radar_cycle([(5.0, 0.1, -1.0)] * 9, 1, 100.0):
        heard.add(message)
    other = tmp_path / "vehicle_motion.dbc"
    other.write_bytes((DBC / "corner_radar.dbc").read_bytes())
    paths = [ROOT / "examples" / "owl" / "owl.dbc", DBC / "corner_radar.dbc", DBC / "vehicle_motion.dbc", other]
    sources = [Source(path, Dbc(path, path).database) for path in paths]
    assert _unused(sources, [DBC / ".." / "dbc" / "vehicle_motion.dbc"], heard) == [
        f"{paths[0]}: none of its messages is in the recording",
        f"{paths[1]}: 2 of its 2 messages are in the recording, and neither a radar nor motion is read by them",
        f"{other}: 2 of its 2 messages are in the recording, and neither a radar nor motion is read by them",
    ]
