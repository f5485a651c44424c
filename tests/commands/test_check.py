"""check and replay of recordings as people bring them: what is there is judged, what is not is said, and the exit status is of both."""

from __future__ import annotations

import gzip
import json
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace

import can
import pytest
from tests.support import recorded, world

from echogrid.commands import check
from echogrid.commands.replay import command as replay_command
from echogrid.errors import EchogridError
from echogrid.store.tile_store import TileStore

START = 1600000000.0
TWO_BUSES = world.CONFIG.replace("[[radar]]", '[[bus]]\nname = "radars"\ninterface = "virtual"\nchannel = "can1"\n\n[[radar]]', 1).replace(
    'bus = "can0"\nx =', 'bus = "radars"\nx ='
)


@pytest.fixture(scope="module")
def messages() -> list[can.Message]:
    """Three seconds past a wall, dated."""
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 120)])
    drive = world.record(world.circle(6.0, 0.1), [wall, world.standing(world.rectangle(12, -5))], 3.0)
    for message in drive:
        message.timestamp = round(message.timestamp - 100 + START, 6)
    return drive


def on_two_buses(messages: Sequence[can.Message]) -> list[can.Message]:
    return [retimed(message, message.timestamp, "can0" if message.arbitration_id < 0x200 else "can1") for message in messages]


def retimed(message: can.Message, time: float, channel: str = "can0") -> can.Message:
    return can.Message(
        timestamp=time,
        arbitration_id=message.arbitration_id,
        is_extended_id=False,
        channel=channel,
        data=message.data,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )


def checked(folder: Path, name: str, data: bytes, capsys: pytest.CaptureFixture[str], config: str = world.CONFIG) -> tuple[str, str]:
    """What check prints, and what is wrong: what it says at last where its exit status is 1, or what it printed where that is 2."""
    path, said, sound = folder / name, "", True
    path.write_bytes(data)
    (folder / "echogrid.toml").write_text(config)
    try:
        sound = check.command(folder / "echogrid.toml", path)
    except EchogridError as error:
        said = str(error)
    printed = capsys.readouterr().out
    return printed, said or ("" if sound else printed)


def replayed(folder: Path, name: str, data: bytes, store: Path | None = None) -> str:
    path, said = folder / name, ""
    path.write_bytes(data)
    (folder / "echogrid.toml").write_text(world.CONFIG)
    try:
        replay_command(
            path,
            folder / "echogrid.toml",
            folder / "out",
            realtime=False,
            model=None,
            record=None,
            store=store,
            learn_first=False,
            as_json=False,
        )
    except EchogridError as error:
        said = str(error)
    return said


def count(printed: str) -> int:
    """The frames of the table."""
    return int(printed.split(" frames in ")[0].split("\n")[-1])


FORMATS: dict[str, Callable[[Sequence[can.Message]], bytes]] = {
    "a.log": lambda m: recorded.joined(recorded.candump(m)),
    "a.asc": lambda m: recorded.joined(recorded.asc(m)),
    "r.asc": lambda m: recorded.joined(recorded.asc(m, "relative")),
    "a.trc": lambda m: recorded.joined(recorded.trc(m)),
    "a.csv": lambda m: recorded.joined(recorded.gvret(m)),
    "a.blf": lambda m: recorded.joined(recorded.blf([recorded.blf_frame(x, START) for x in m], START)),
    "a.pcapng": lambda m: recorded.joined(recorded.pcapng(m)),
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_says_the_same_of_a_drive(
    tmp_path: Path, name: str, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    printed, said = checked(tmp_path, name, FORMATS[name](messages), capsys)
    assert said == ""
    assert count(printed) == len(messages)
    assert "in 3.0 s, 0 of other ids, 0 bad, 0 missing" in printed
    assert printed.endswith("nothing wrong was found\n")


@pytest.mark.parametrize("name", FORMATS)
def test_can0_1_and_the_number_of_the_file_mean_the_same_bus(
    tmp_path: Path, name: str, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    data = FORMATS[name](on_two_buses(messages))
    first = 0 if name == "a.csv" else 1  # SavvyCAN's buses count from 0
    numbered = TWO_BUSES.replace('channel = "can0"', f'channel = "x"\nlog_channel = {first}').replace(
        'channel = "can1"', f'channel = "y"\nlog_channel = {first + 1}'
    )
    for config in (TWO_BUSES, numbered) if not name.endswith((".log", ".pcapng")) else (TWO_BUSES,):
        assert checked(tmp_path, name, data, capsys, config)[1] == ""
    swapped = TWO_BUSES.replace('"can1"', '"x"').replace('channel = "can0"', 'channel = "can1"').replace('"x"', '"can0"')
    assert "[wrong_bus] motion: its frames are on bus " in checked(tmp_path, name, data, capsys, swapped)[1]


def test_another_channel_is_named(tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]) -> None:
    other = [retimed(message, message.timestamp, "vcan0") for message in messages]
    data = recorded.joined(recorded.candump(other))
    sentence = "frames with ids that are read are of channel 'vcan0', expected 'can0': give log_channel = \"vcan0\" to the bus 'can0'"
    found = checked(tmp_path, "a.log", data, capsys)[1]
    assert "[wrong_channel] bus 'can0': " in found
    assert 'mend: [[bus]] can0: log_channel = "vcan0"' in found
    assert replayed(tmp_path, "a.log", data).endswith(f"knows: {sentence}")
    third = [retimed(message, message.timestamp, "can2") for message in messages]
    said = checked(tmp_path, "a.trc", recorded.joined(recorded.trc(third)), capsys)[1]
    assert "mend: [[bus]] can0: log_channel = 3" in said
    assert not (tmp_path / "out").exists()


def test_buses_that_a_format_does_not_say_cannot_be_told_apart(
    tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("p.csv", "p.db"):
        data = recorded.by_python_can(tmp_path / name, messages).read_bytes()
        assert checked(tmp_path, f"a{name[1:]}", data, capsys)[1] == ""
        said = checked(tmp_path, f"a{name[1:]}", data, capsys, TWO_BUSES)[1]
        assert "[no_channels] the recording does not say channels, so its buses cannot be told apart" in said
        assert said.endswith(": 1 mistake found\n")  # nobody's frames are called missing


def test_ids_of_another_length_are_named(tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]) -> None:
    lines = [line.replace(" can0 ", " can0 00000") for line in recorded.candump(messages)]
    said = checked(tmp_path, "a.log", recorded.joined(lines), capsys)[1]
    assert "ids such as 0x100 are there with 29 bits, expected with 11" in said


@pytest.mark.parametrize("step", [1.0, 0.1, 0.05])
def test_coarse_times_are_said(tmp_path: Path, step: float, messages: list[can.Message], capsys: pytest.CaptureFixture[str]) -> None:
    coarse = [retimed(message, START + int((message.timestamp - START) / step + 1e-6) * step) for message in messages]
    data = recorded.joined(recorded.candump(coarse))
    printed, said = checked(tmp_path, "a.log", data, capsys)
    rate = re.search(r"^speed +([\d.]+) Hz", printed, re.MULTILINE)
    assert rate is not None
    assert "[silence]" not in printed
    assert 50 < float(rate[1]) < 155  # of 100 Hz, less what waits for sound times, in 2 or 3 s
    for one in (said, replayed(tmp_path, "a.log", data)):
        assert f"its times are too coarse: they go on in steps of {step:g} s" in one


def test_a_pause_is_one_in_coarse_times_too(tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]) -> None:
    later = [retimed(message, message.timestamp + 5.0 * (message.timestamp > START + 1.0)) for message in messages]
    coarse = [retimed(message, START + int((message.timestamp - START) / 0.1 + 1e-6) * 0.1) for message in later]
    printed, said = checked(tmp_path, "a.log", recorded.joined(recorded.candump(coarse)), capsys)
    assert "its times are too coarse: they go on in steps of 0.1 s" in said
    assert "[silence] recording: it pauses, for 5" in printed


def test_frames_that_are_there_twice_are_not_called_coarse(
    tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    data = recorded.joined([line for line in recorded.candump(messages) for _ in range(2)])
    for one in (checked(tmp_path, "a.log", data, capsys)[1], replayed(tmp_path, "a.log", data)):
        assert "frames of ego motion have the time of the one before; they are there twice, or were stamped many at once" in one


@pytest.mark.parametrize("name", ["a.log", "a.csv", "a.blf"])
def test_times_that_stand_still_are_said(
    tmp_path: Path, name: str, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    for time in (0.0, START):
        data = FORMATS[name]([retimed(message, time) for message in messages]) if name != "a.blf" or time else b""
        if data:
            sentence = f"its times do not go on: all {len(messages)} frames are of {time:.6f} s"
            printed, said = checked(tmp_path, name, data, capsys)
            assert sentence in said
            assert re.search(r"^speed +0\.0 Hz", printed, re.MULTILINE)
            assert printed.endswith("nothing else wrong was found\n")
            assert sentence in replayed(tmp_path, name, data)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["summary.json"]


def test_times_that_go_back_are_said(tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]) -> None:
    anew = recorded.joined(recorded.candump([retimed(message, (message.timestamp - START) % 1.0) for message in messages]))
    printed, said = checked(tmp_path, "anew.log", anew, capsys)
    assert "in 1.0 s, " in printed
    assert "its times go back 3 times, by up to 0.99" in said
    assert "its times go back 3 times, by up to 0.99" in replayed(tmp_path, "anew.log", anew)
    half = len(messages) // 2
    printed, said = checked(tmp_path, "halves.log", recorded.joined(recorded.candump(messages[half:] + messages[:half])), capsys)
    assert "in 3.0 s, " in printed
    assert "its times go back once, by 3." in said


def test_a_few_milliseconds_of_disorder_are_a_note(tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]) -> None:
    mixed = [*messages]
    mixed[10], mixed[11] = mixed[11], mixed[10]
    printed, said = checked(tmp_path, "a.log", recorded.joined(recorded.candump(mixed)), capsys)
    assert "its frames are out of order by up to " in printed
    assert said == ""


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        ("# a comment", "comments 1"),
        ("DROPCOUNT: dropped 2 CAN frames on 'can0' socket (total drops 2)", "notices of dropped frames 1"),
        ("(1600000001.000000) can0 45123#81:00:12345678#1122334455667788", "CAN XL frames 1"),
        ("(1600000001.000000) can0 701#R8", "remote frames 1"),
        ("(1600000001.000000) can0 20000080#0000000000000000", "error frames 1"),
    ],
)
def test_what_is_no_data_frame_is_counted_by_kind(
    tmp_path: Path, line: str, kind: str, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    lines = recorded.candump(messages)
    lines.insert(sum(message.timestamp < START + 1 for message in messages), line)
    printed, said = checked(tmp_path, "a.log", recorded.joined(lines), capsys)
    assert f"not data frames: {kind}\n" in printed
    assert ("other ids, most" in printed) == kind.startswith("remote")
    assert said == ""
    assert count(printed) == len(messages) + kind.startswith("remote")


def test_a_line_that_is_not_understood_is_said_and_costs_no_frame(
    tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    lines = recorded.candump(messages)
    lines.insert(99, "(1600000001.0000")
    printed, said = checked(tmp_path, "a.log", recorded.joined(lines), capsys)
    assert count(printed) == len(messages)
    assert said.endswith("a.log: 1 of its parts could not be understood, the first is line 100: '(1600000001.0000'")
    assert replayed(tmp_path, "a.log", recorded.joined(lines)).endswith(f"; the map of all else is in {tmp_path / 'out'}")


@pytest.mark.parametrize("name", ["a.blf", "a.log.gz", "a.blf.gz", "a.mcap"])
def test_a_torn_recording_is_judged_and_then_said_to_be_torn(
    tmp_path: Path, name: str, messages: list[can.Message], capsys: pytest.CaptureFixture[str]
) -> None:
    if name == "a.mcap":
        from echogrid.recording.mcap_writer import McapWriter

        with McapWriter(tmp_path / "whole.mcap") as writer:
            for index, message in enumerate(messages):
                writer.frame("can0", message)
                if index % 100 == 0:
                    writer.flush()
        data = (tmp_path / "whole.mcap").read_bytes()
    else:
        data = FORMATS[name.removesuffix(".gz")](messages)
        data = gzip.compress(data) if name.endswith(".gz") else data
    printed, said = checked(tmp_path, name, data[: len(data) * 6 // 10], capsys)
    assert len(messages) * 0.2 < count(printed) < len(messages)
    assert "front_left" in printed
    assert f"cannot be read beyond message {count(printed)}: " in said
    assert replayed(tmp_path, name, data[: len(data) * 6 // 10]).endswith(f"; the map up to there is in {tmp_path / 'out'}")


@pytest.mark.parametrize("name", ["a.asc", "a.trc", "a.blf"])
def test_a_dated_head_dates_the_map(tmp_path: Path, name: str, messages: list[can.Message]) -> None:
    path = tmp_path / "a.egmap"
    assert replayed(tmp_path, name, FORMATS[name](messages), path) == ""
    with TileStore(path) as store:
        (epoch,) = store.epochs()
        assert epoch.description.begun_ns == pytest.approx(START * 1e9, abs=1e6)


def test_without_a_date_that_is_said(tmp_path: Path, messages: list[can.Message], capsys: pytest.CaptureFixture[str]) -> None:
    lines = [line for line in recorded.asc(messages) if not line.startswith("date")]
    printed, said = checked(tmp_path, "a.asc", recorded.joined(lines), capsys)
    assert "it has no date: its times count from the beginning of 1970\n" in printed
    assert said == ""
    assert replayed(tmp_path, "a.asc", recorded.joined(lines)) == ""
    assert "note: it has no date: its times count from the beginning of 1970\n" in capsys.readouterr().out


def test_a_replay_without_a_map_is_no_success(tmp_path: Path, messages: list[can.Message]) -> None:
    motion = [message for message in messages if message.arbitration_id < 0x200]
    said = replayed(tmp_path, "a.log", recorded.joined(recorded.candump(motion)))
    assert "no map came of it: it has 0 complete scans and " in said
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["summary.json"]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["files"] == ["summary.json"]
    assert (summary["not_to_be_trusted"], summary["worst_state"], summary["cycles"]) == ("it is empty", "stale", 0)


def test_what_mf4_needs_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def find_spec(name: str, *_: object) -> None:
        if name == "asammdf":
            raise ImportError(name)

    monkeypatch.delitem(sys.modules, "asammdf", raising=False)
    monkeypatch.setattr(sys, "meta_path", [SimpleNamespace(find_spec=find_spec), *sys.meta_path])
    said = checked(tmp_path, "a.mf4", b"MDF     4.11    ", capsys)[1]
    assert said.endswith("a.mf4: reading .mf4 files needs the package asammdf: pip install asammdf")
