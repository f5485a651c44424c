"""A recording under a wrong name is told what it is; one under its own name is not."""

from __future__ import annotations

import gzip
from pathlib import Path

import can
import pytest
import zstandard
from tests.support.frames import wheel_speeds

from echogrid.errors import EchogridError
from echogrid.logs.log import BY_PATH, OURS, Log
from echogrid.recording.mcap_writer import McapWriter

MESSAGES = [wheel_speeds(3.0, n, 1000.0 + n / 100) for n in range(20)]
ENDINGS = (".log", ".asc", ".blf", ".csv", ".db", ".trc")  # that python-can writes; .mcap is ours


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("recordings")
    for ending in ENDINGS:
        with can.Logger(folder / f"a{ending}") as logger:
            for message in MESSAGES:
                logger.on_message_received(message)
    with McapWriter(folder / "a.mcap") as writer:
        for message in MESSAGES:
            writer.frame("can0", message)
    return {ending: (folder / f"a{ending}").read_bytes() for ending in (*ENDINGS, ".mcap")}


def complaint(path: Path, data: bytes) -> str:
    path.write_bytes(data)
    with pytest.raises(EchogridError) as refused:
        list(Log(path))
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("name", [*sorted(OURS), ".mcap", ".mf4"])  # of .mf4 without asammdf, for which nobody has to install it
def test_each_kind_under_the_name_of_each_other(recordings: dict[str, bytes], tmp_path: Path, name: str) -> None:
    for ending, data in recordings.items():
        if ending != name:
            assert complaint(tmp_path / f"a{name}", data).endswith(
                f"; by its first bytes it is a {ending} recording: give it a name that ends so"
            )


@pytest.mark.parametrize("name", [*ENDINGS, ".mcap"])
def test_what_is_packed_and_is_not_named_so_and_the_other_way_round(recordings: dict[str, bytes], tmp_path: Path, name: str) -> None:
    data = recordings[name]
    if name != ".db":  # which a library reads by its path
        assert complaint(tmp_path / f"a{name}", gzip.compress(data)).endswith(f"; it is packed: give it a name that ends in {name}.gz")
    assert complaint(tmp_path / f"b{name}", zstandard.compress(data)).endswith(f"; it is packed: give it a name that ends in {name}.zst")
    assert complaint(tmp_path / f"a{name}.gz", data).endswith(f"; it is not packed: give it a name that ends in {name}")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("  can0  100   [8]  4A 10 9C 0E B5 0E 03 00\n", "; candump shows no times by itself: record with candump -L, or -l"),
        ("\x1b[31m (1600000000.0)  can0  100   [2]  4A 10\x1b[0m\n", "; it has colours for a terminal: record with candump -L, or -l"),
    ],
)
def test_what_candump_shows_by_itself_is_told_how_to_be_recorded(tmp_path: Path, line: str, said: str) -> None:
    assert complaint(tmp_path / "a.log", line.encode() * 9).endswith(said)


def test_a_file_that_is_what_its_name_says_gets_no_hint(recordings: dict[str, bytes], tmp_path: Path) -> None:
    for name, data in recordings.items():
        path = tmp_path / f"a{name}"
        path.write_bytes(data)
        assert len(list(Log(path))) == len(MESSAGES)
    for name, data in (
        (".log", b"nothing\n"),
        (".asc", b"base hex  timestamps absolute\n"),
        (".blf", b"LOGG"),
        (".log.gz", gzip.compress(b"x")),
    ):
        assert "give it a name" not in complaint(tmp_path / f"b{name}", data)


def test_an_ending_that_is_mistyped_is_told_the_file_that_is_there(tmp_path: Path) -> None:
    (tmp_path / "drive.blf").write_bytes(b"")
    with pytest.raises(EchogridError, match=r"drive\.bfl: there is no such file; did you mean .*drive\.blf\?$"):
        Log(tmp_path / "drive.bfl")


@pytest.mark.parametrize("name", [*OURS, *BY_PATH, ".mcap", ".log.gz", ".blf.zst"])
def test_an_empty_file_is_called_empty(tmp_path: Path, name: str) -> None:
    assert complaint(tmp_path / f"a{name}", b"").endswith("; the file is empty")
