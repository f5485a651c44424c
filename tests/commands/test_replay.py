"""Replay: the same log gives the same map, its files say what they hold, and bad input is one sentence."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import can
import numpy as np
import pytest
from PIL import Image
from tests.support import frames, networks, world
from tests.support.program import echogrid

from echogrid.commands.replay import replay
from echogrid.core.evidence.raster import GridSpec
from echogrid.errors import EchogridError, NoMapError
from echogrid.logs.drive import find_drive

SHAPE = {"complete", "incomplete", "late"}
KEYS = {"drive_s", "wall_s", "frames", "bad_frames", "cycles", "scans", "detections", "static_detections", "distance_m", "cycle_ms"}


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 120)])
    messages = world.record(world.circle(6.0, 0.1), [wall, world.standing(world.rectangle(12, -5))], 4.0)
    return world.write_drive(tmp_path_factory.mktemp("drive"), messages)


def test_a_folder_needs_nothing_else_and_twice_is_the_same(drive: Path, tmp_path: Path) -> None:
    done = echogrid("replay", drive, "--out", tmp_path / "one")
    assert (done.returncode, done.stderr) == (0, "")
    replay(find_drive(drive, None), tmp_path / "two")
    one, two = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("one", "two"))
    assert one["map_sha256"] == two["map_sha256"]
    assert set(one) >= KEYS
    assert all(set(counts) >= SHAPE for counts in one["scans"].values())
    assert set(one["cycle_ms"]) == {"p50", "p99", "max"}
    assert one["rss_mib"] > 10
    for name in ("map.npz", "map.pgm", "map.yaml", "map.png", "trajectory.csv"):
        assert (tmp_path / "one" / name).is_file()
        if name != "map.npz":  # a zip holds the time of writing
            assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_a_network_gives_the_same_map_twice_and_its_files_say_which(drive: Path, tmp_path: Path) -> None:
    """Through the command line and through the function, bit for bit; another map than the analytic one's."""
    spec = GridSpec()
    net = networks.write(tmp_path / "net.onnx", *networks.default(spec.cells, spec.cell))
    done = echogrid("replay", drive, "--model", net, "--out", tmp_path / "one")
    assert (done.returncode, done.stderr) == (0, "")
    one = json.loads((tmp_path / "one" / "summary.json").read_text())
    two = replay(find_drive(drive, None), tmp_path / "two", model=str(net))
    analytic = replay(find_drive(drive, None), tmp_path / "analytic")
    assert one["model"] == two["model"]
    assert one["model"].startswith("net.onnx, as configured, SHA-256 ")
    assert analytic["model"] == "the analytic model, as configured"
    assert one["map_sha256"] == two["map_sha256"] != analytic["map_sha256"]
    with np.load(tmp_path / "one" / "map.npz") as file:
        assert (file["log_odds"] > 1).sum() > 50
        assert (file["log_odds"] < -1).sum() > 1000


def test_a_network_that_is_none_is_one_sentence(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "net.onnx").write_bytes(b"noise")
    done = echogrid("replay", drive, "--model", tmp_path / "net.onnx", "--out", tmp_path / "out")
    assert done.returncode == 1
    start = f"echogrid: {drive / 'echogrid.toml'}: model: {tmp_path / 'net.onnx'}: is not an ONNX model that onnxruntime reads: "
    assert done.stderr.startswith(start)
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_map_and_the_trajectory_hold_what_they_say(drive: Path, tmp_path: Path) -> None:
    summary = replay(find_drive(drive, None), tmp_path)
    with np.load(tmp_path / "map.npz") as file:
        log_odds, origin, cell = file["log_odds"], file["origin"], float(file["cell"])
    assert log_odds.dtype == np.float32
    rows, columns = np.nonzero(log_odds > 1)
    x, y = origin[0] + (columns + 0.5) * cell, origin[1] + (rows + 0.5) * cell
    wall = (np.abs(y - 6.0) < 0.5).sum()
    assert wall > 50
    assert (np.abs(y - 6.0) < 0.5).sum() + ((np.abs(x - 12) < 2.8) & (np.abs(y + 5) < 1.6)).sum() == len(x)
    with (tmp_path / "trajectory.csv").open() as file_:
        trajectory = list(csv.DictReader(file_))
    assert list(trajectory[0]) == ["stamp_ns", "x", "y", "yaw"]
    end = trajectory[-1]
    time = int(end["stamp_ns"]) * 1e-9 - 100 - 0.001
    assert float(end["x"]) == pytest.approx(60 * np.sin(0.1 * time), abs=0.05)
    assert float(end["y"]) == pytest.approx(60 * (1 - np.cos(0.1 * time)), abs=0.05)
    assert summary["distance_m"] == pytest.approx(24.0, abs=0.2)


def test_map_server_files_agree_with_the_map(drive: Path, tmp_path: Path) -> None:
    """Read back as ROS map_server does: the first row of the picture is the largest y, dark is occupied."""
    replay(find_drive(drive, None), tmp_path)
    fields = dict(line.split(": ", 1) for line in (tmp_path / "map.yaml").read_text().splitlines())
    grey = np.asarray(Image.open(tmp_path / fields["image"]), dtype=float)[::-1]
    with np.load(tmp_path / "map.npz") as file:
        log_odds, origin = file["log_odds"], file["origin"]
        assert float(fields["resolution"]) == file["cell"]
    assert json.loads(fields["origin"]) == [*origin.tolist(), 0.0]
    darkness = (255 - grey) / 255
    p = 1 / (1 + np.exp(-log_odds.astype(float)))
    assert (float(fields["occupied_thresh"]), float(fields["free_thresh"])) == (0.5, 0.1)
    assert ((darkness >= 0.5) == ((p >= 0.5) & (log_odds != 0))).all()
    assert ((darkness <= 0.1) == ((p <= 0.1) & (log_odds != 0))).all()


def test_other_formats_give_the_same_map(drive: Path, tmp_path: Path) -> None:
    digests = set()
    for name in ("can.log", "can.blf", "can.log.gz"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "echogrid.toml").write_bytes((drive / "echogrid.toml").read_bytes())
        with can.Logger(folder / name) as logger:
            for message in can.LogReader(drive / "can.log"):
                logger.on_message_received(message)
        digests.add(replay(find_drive(folder, None), folder / "out")["map_sha256"])
    assert len(digests) == 1


def test_in_real_time_it_takes_as_long_as_the_drive(drive: Path, tmp_path: Path) -> None:
    log = tmp_path / "short.log"
    log.write_text("".join((drive / "can.log").read_text().splitlines(keepends=True)[:600]))
    summary = replay(find_drive(log, drive / "echogrid.toml"), tmp_path / "out", realtime=True)
    assert summary["drive_s"] > 0.5
    assert summary["wall_s"] >= summary["drive_s"] - 0.05


def test_a_log_with_junk_is_mapped_without_it(drive: Path, tmp_path: Path) -> None:
    log = tmp_path / "torn.log"
    log.write_text((drive / "can.log").read_text()[: -len("#garbage")] + "\n(12 what\n")
    done = echogrid("replay", log, "-c", drive / "echogrid.toml", "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.startswith(f"echogrid: {log}: 2 of its parts could not be understood, the first is line ")
    assert done.stderr.endswith(f"the map of all else is in {tmp_path / 'out'}\n")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["cycles"] > 50


def test_time_that_goes_backwards_is_dropped_and_counted(drive: Path, tmp_path: Path) -> None:
    lines = (drive / "can.log").read_text().splitlines(keepends=True)
    (tmp_path / "twice.log").write_text("".join(lines + lines[:200]))
    summary = replay(find_drive(tmp_path / "twice.log", drive / "echogrid.toml"), tmp_path / "out")
    once = replay(find_drive(drive, None), tmp_path / "once")
    assert summary["bad_frames"] == 200
    assert summary["map_sha256"] == once["map_sha256"]


@pytest.mark.parametrize(
    ("name", "content", "code", "complaint"),
    [
        ("other.log", "(1.0) can0 123#00\n(2.0) can0 456#00\n", 3, "none of its 2 frames is one that"),
        ("odd.log", "(1.0) can0 123#00\nnoise\n", 1, "the first is line 2: 'noise'; none of its 1 frames is one that"),
        ("empty.log", "", 1, "holds no CAN message"),
        ("noise.log", "\x00\x01\x02", 1, "holds no CAN message; 1 of its parts could not be understood, the first is line 1: "),
        ("log.txt", "", 1, "is not a known log format"),
    ],
)
def test_bad_logs_are_one_sentence_and_write_nothing(
    drive: Path, tmp_path: Path, name: str, content: str, code: int, complaint: str
) -> None:
    (tmp_path / name).write_text(content)
    done = echogrid("replay", tmp_path / name, "-c", drive / "echogrid.toml", "--out", tmp_path / "out")
    assert done.returncode == code
    assert done.stderr.startswith(f"echogrid: {tmp_path / name}: ")
    assert complaint in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_bad_frames_are_not_called_those_of_another_car(drive: Path, tmp_path: Path) -> None:
    log = tmp_path / "short.log"
    log.write_text(re.sub(r"(#(#.)?)[0-9A-F]+", r"\g<1>00", (drive / "can.log").read_text()))
    with pytest.raises(NoMapError) as refused:
        replay(find_drive(log, drive / "echogrid.toml"), tmp_path / "out")
    frames = len(log.read_text().splitlines())
    assert "no map came of it: it has 0 complete scans and " in str(refused.value)
    assert f"; {frames} frames are bad: too short, " in str(refused.value)


def test_what_is_missing_is_said(drive: Path, tmp_path: Path) -> None:
    with pytest.raises(EchogridError, match="a log needs a configuration"):
        find_drive(drive / "can.log", None)
    with pytest.raises(EchogridError, match="is no recording: give a configuration with -c"):
        find_drive(drive / "echogrid.toml", None)
    with pytest.raises(EchogridError, match="there is no such file or folder"):
        find_drive(tmp_path / "nothing", None)
    with pytest.raises(EchogridError, match="holds no recording, expected one of can.log.gz"):
        find_drive(tmp_path, None)
    (tmp_path / "can.log").write_text("")
    with pytest.raises(EchogridError, match=r"holds can\.log and no echogrid\.toml: give a configuration with -c"):
        find_drive(tmp_path, None)
    assert find_drive(tmp_path, tmp_path / "car.toml").config == tmp_path / "car.toml"


def test_an_output_that_cannot_be_written_is_said(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = echogrid("replay", drive, "--out", tmp_path / "file")
    assert done.returncode == 1
    assert done.stderr == f"echogrid: {tmp_path / 'file'}: is a file, expected a folder\n"


def test_another_programs_truth_file_is_said_and_stops_nothing(drive: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    for name in ("echogrid.toml", "can.log"):
        (folder / name).write_bytes((drive / name).read_bytes())
    np.savez(folder / "truth.npz", stamp_ns=np.arange(3))
    said: list[str] = []
    summary = replay(find_drive(folder, None), tmp_path / "out", say=said.append)
    assert said[0].startswith(f"not used: {folder / 'truth.npz'}: is not a truth file with the arrays stamp_ns, x, y and yaw")
    assert "trajectory_rmse_m" not in summary
    assert summary["map_sha256"] == replay(find_drive(drive, None), tmp_path / "without")["map_sha256"]


def test_a_map_that_is_not_there_is_not_named(drive: Path, tmp_path: Path) -> None:
    """Radars without ego motion: exit code 3, a summary with its state, and no file but it."""
    with can.Logger(tmp_path / "radars.log") as logger:
        for message in can.LogReader(drive / "can.log"):
            if message.arbitration_id >= 0x200:
                logger.on_message_received(message)
    done = echogrid("replay", tmp_path / "radars.log", "-c", drive / "echogrid.toml", "--out", tmp_path / "out")
    assert done.returncode == 3
    assert done.stderr.startswith(f"echogrid: {tmp_path / 'radars.log'}: no map came of it: it has ")
    assert done.stderr.count("\n") == 1
    assert "map.png" not in done.stdout
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["files"], summary["not_to_be_trusted"], summary["map_sha256"]) == (["summary.json"], "it is empty", None)
    assert sum(summary["seconds"].values()) == pytest.approx(summary["drive_s"], abs=0.02)


def test_radars_on_another_bus_or_channel_are_named_with_the_line_that_mends_it(drive: Path, tmp_path: Path) -> None:
    """The rear radars are recorded on another channel: a map of the front ones, and what would mend it; then a bus that is configured."""
    with can.Logger(tmp_path / "two.log") as logger:
        for message in can.LogReader(drive / "can.log"):
            message.channel = "vcan7" if message.arbitration_id >= 0x320 else "can0"
            logger.on_message_received(message)
    split = (drive / "echogrid.toml").read_text().split("[[radar]]")
    rear = [part.replace('bus = "can0"', 'bus = "rear"') for part in split[3:]]
    two = split[0] + '[[bus]]\nname = "rear"\nchannel = "can1"\n\n[[radar]]' + "[[radar]]".join([*split[1:3], *rear])
    (tmp_path / "echogrid.toml").write_text(two)
    done = echogrid("replay", tmp_path / "two.log", "-c", tmp_path / "echogrid.toml", "--out", tmp_path / "out")
    note = "note: frames with ids that are read are of channel 'vcan7', expected 'can1': give log_channel = \"vcan7\" to the bus 'rear'\n"
    assert note in done.stdout
    mended = two.replace('channel = "can1"', 'channel = "can1"\nlog_channel = "vcan7"')
    (tmp_path / "echogrid.toml").write_text(mended)
    done = echogrid("replay", tmp_path / "two.log", "-c", tmp_path / "echogrid.toml", "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    assert "note: frames" not in done.stdout
    assert "note: ids" not in done.stdout
    parts = mended.split("[[radar]]")
    parts[4] = parts[4].replace('bus = "rear"', 'bus = "can0"')
    (tmp_path / "echogrid.toml").write_text("[[radar]]".join(parts))
    done = echogrid("replay", tmp_path / "two.log", "-c", tmp_path / "echogrid.toml", "--out", tmp_path / "out")
    assert "note: ids such as 0x330 are on bus 'rear', expected on 'can0': give that bus to [[radar]] rear_right\n" in done.stdout


def test_a_pause_of_the_recording_is_no_time_of_a_good_map(drive: Path, tmp_path: Path) -> None:
    """The bus slept for two minutes: nobody would have called the map right meanwhile, and what was mapped is none the worse."""
    with can.Logger(tmp_path / "pause.log") as logger:
        for message in can.LogReader(drive / "can.log"):
            message.timestamp += 120.0 * (message.timestamp > 102.0)
            logger.on_message_received(message)
    done = echogrid("replay", tmp_path / "pause.log", "-c", drive / "echogrid.toml", "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["seconds"]["stale"] == pytest.approx(120.0, abs=1.0)
    assert sum(summary["seconds"].values()) == pytest.approx(summary["drive_s"], abs=0.02)
    assert [change["state"] for change in summary["changes"]] == ["ok", "stale", "ok"]
    assert summary["changes"][1]["reason"].startswith("nothing received for 120.")
    assert done.stdout.index("stale: nothing received") < done.stdout.index("new map: ego motion: the first sample")


def test_where_channels_have_other_names_no_radar_is_sent_to_another_bus(drive: Path, tmp_path: Path) -> None:
    """A configuration out of a file that numbers channels, and a log that names them: 'can1' is taken for number 1."""
    with can.Logger(tmp_path / "two.log") as logger:
        for message in can.LogReader(drive / "can.log"):
            message.channel = "can1" if message.arbitration_id >= 0x320 else "can0"
            logger.on_message_received(message)
    numbered = (drive / "echogrid.toml").read_text().split("[[radar]]")
    second = '[[bus]]\nname = "rear"\nchannel = "can1"\nlog_channel = 2\n\n[[radar]]'
    rear = [part.replace('bus = "can0"', 'bus = "rear"') for part in numbered[3:]]
    text = numbered[0].replace('channel = "can0"', 'channel = "can0"\nlog_channel = 1') + second + "[[radar]]".join([*numbered[1:3], *rear])
    (tmp_path / "echogrid.toml").write_text(text)
    with pytest.raises(NoMapError) as said:
        replay(find_drive(tmp_path / "two.log", tmp_path / "echogrid.toml"), tmp_path / "out")
    assert str(said.value).endswith("of channel 'can0', expected '1': give log_channel = \"can0\" to the bus 'can0'")


def test_changes_of_state_are_said_and_counted(drive: Path, tmp_path: Path) -> None:
    """A radar that is silent for a second in the middle, and ego motion that is lost at the end: no map to be trusted."""
    with can.Logger(tmp_path / "faults.log") as logger:
        for message in can.LogReader(drive / "can.log"):
            radar_away = 101.5 < message.timestamp < 102.5 and 0x320 <= message.arbitration_id < 0x330
            if not radar_away and not (message.timestamp > 103.2 and message.arbitration_id == 0x102):
                logger.on_message_received(message)
    done = echogrid("replay", tmp_path / "faults.log", "-c", drive / "echogrid.toml", "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (3, "")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    changes = [(change["state"], change["reason"]) for change in summary["changes"]]
    assert [state for state, _ in changes] == ["ok", "degraded", "ok", "no_motion"]
    assert changes[1][1].startswith(("radar rear_left: silent for 0.5", "radar rear_left: silent for 0.6"))
    assert "degraded: radar rear_left: silent" in done.stdout
    assert "the map is not to be trusted: it ends no_motion: yaw rate: silent for" in done.stdout
    assert summary["worst_state"] == "no_motion"
    assert sum(summary["seconds"].values()) == pytest.approx(summary["drive_s"], abs=0.02)
    assert summary["seconds"]["degraded"] == pytest.approx(0.55, abs=0.2)
    assert summary["maps_begun"] == []


def test_check_praises_a_whole_log_and_blames_a_holey_one(drive: Path, tmp_path: Path) -> None:
    done = echogrid("check", "-c", drive / "echogrid.toml", drive / "can.log")
    assert (done.returncode, done.stderr) == (0, "")
    rows = {line.split()[0]: line for line in done.stdout.splitlines() if line}
    assert "100.0 Hz" in rows["speed"]
    assert all("20.0 Hz" in rows[name] for name in world.RADARS)
    kept = [m for n, m in enumerate(can.LogReader(drive / "can.log")) if m.arbitration_id != 0x311 or n % 11]
    with can.Logger(tmp_path / "holes.log") as logger:
        for message in kept:
            if not 0x320 <= message.arbitration_id < 0x330:
                logger.on_message_received(message)
    done = echogrid("check", "-c", drive / "echogrid.toml", tmp_path / "holes.log")
    assert (done.returncode, done.stderr) == (2, "")
    assert "[lost_frames] radar front_right: " in done.stdout
    assert "[radar_missing] radar rear_left: none of its frames (0x320, 0x321) was heard" in done.stdout


def test_learned_first_a_stop_at_the_end_straightens_the_whole_way(tmp_path: Path) -> None:
    """A gyro that shows 1°/s too much, and a stop when all is driven: what that tells helps from the start on, twice alike."""
    seconds, speed, bias = 12.0, 6.0, np.radians(1.0)
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 300)])
    driven = world.record(world.straight(speed), [wall], seconds)
    rates = [message for message in driven if message.arbitration_id == 0x102]
    shown = {id(message): frames.yaw_rate(bias, n, message.timestamp) for n, message in enumerate(rates)}
    messages = [shown.get(id(message), message) for message in driven]
    begin, count = messages[-1].timestamp, len(rates)
    braking = [max(speed - 0.06 * n, 0.0) for n in range(100)] + [0.0] * 600
    for n, wheels in enumerate(braking, 1):
        time = begin + n * 0.01
        messages += [frames.wheel_speeds(wheels, count + n - 1, time), frames.yaw_rate(bias, count + n - 1, time + 0.001)]
    drive = world.write_drive(tmp_path / "drive", messages)
    once = replay(find_drive(drive, None), tmp_path / "once")
    twice = [replay(find_drive(drive, None), tmp_path / name, learn_first=True) for name in ("first", "again")]
    assert once["learned"]["yaw_rate_bias_deg_s"] == pytest.approx(1.0, abs=0.02)
    assert twice[0]["learned"]["yaw_rate_bias_deg_s_applied"] == pytest.approx(1.0, abs=0.02)
    assert twice[0]["map_sha256"] == twice[1]["map_sha256"] != once["map_sha256"]
    aside = []
    for name in ("once", "first"):
        with (tmp_path / name / "trajectory.csv").open() as file:
            aside.append(max(abs(float(row["y"])) for row in csv.DictReader(file)))
    assert aside[0] > 5.0
    assert aside[1] < 0.3


def test_what_may_not_learn_cannot_learn_first(drive: Path, tmp_path: Path) -> None:
    path = tmp_path / "never.toml"
    path.write_text((drive / "echogrid.toml").read_text().replace("[motion]\n", '[motion]\nlearns = "never"\n'))
    done = echogrid("replay", drive / "can.log", "-c", path, "--learn-first", "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr == f"echogrid: {path}: motion.learns: 'never' found, expected 'driving' or 'standing' with --learn-first\n"
    done = echogrid("replay", drive, "--learn-first", "--publish")
    assert done.stderr == "echogrid: --learn-first: found with --publish, expected one of them\n"
