"""Files that cannot be written: which one is said, and nothing is left of it."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from echogrid.cli import _parser
from echogrid.commands.replay import replay
from echogrid.errors import EchogridError
from echogrid.files import no_file, whole
from echogrid.logs.drive import find_drive
from tests.support import disk, world
from tests.support.places import DEMO
from tests.support.waiting import PATIENCE


def written(path: Path) -> None:
    """As far as there is room."""
    with whole(path) as partial:
        for end in ("", "-wal", "-shm"):  # as SQLite leaves them where it cannot close a file
            Path(f"{partial}{end}").write_text("")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_file_that_cannot_be_written_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space left on device") as full:
        written(tmp_path / "a.egmap")
    assert full.value.filename == str(tmp_path / "a.egmap")
    assert list(tmp_path.iterdir()) == []


def test_two_that_write_the_same_file_do_not_meet(tmp_path: Path) -> None:
    """Each has a name of its own, and the last one's file is there at the end; a name that a killed one has left is used again."""
    path = tmp_path / "map.learned.json"
    (tmp_path / ".map.learned.json.partial").write_bytes(b"half of what was written before a kill")
    with whole(path) as first:
        first.write_bytes(b"first, half")
        with whole(path) as second:
            second.write_bytes(b"second")
            with pytest.raises(OSError, match="No space left on device"):
                written(path)
        assert (path.read_bytes(), first.read_bytes()) == (b"second", b"first, half")
        first.write_bytes(b"first")
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]


def test_of_processes_that_write_the_same_file_none_fails(tmp_path: Path) -> None:
    """What they leave is always whole. Each writes as often as the others let it, for as long as they do."""
    code = """
import sys
from pathlib import Path
from echogrid.files import whole

path, mine = Path(sys.argv[1]), sys.argv[2] * 20_000
for _ in range(100):
    with whole(path) as partial:
        partial.write_text(mine)
    found = path.read_text()
    assert len(found) == 20_000 and len(set(found)) == 1, found[:9]
"""
    path = tmp_path / "a"
    writers = [subprocess.Popen([sys.executable, "-c", code, path, letter], stderr=subprocess.PIPE) for letter in "abc"]
    said = [writer.communicate(timeout=PATIENCE)[1] for writer in writers]
    assert [(writer.returncode, text) for writer, text in zip(writers, said, strict=True)] == [(0, b"")] * 3
    assert list(tmp_path.iterdir()) == [path]


def test_of_a_recording_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Written to where there is never room; tests/maps/test_full_disk.py has the other files of a replay."""
    drive = world.write_drive(tmp_path / "drive", world.record(world.straight(6.0), [world.standing([(9.0, 3.0)])], 1.0))
    record, usual = tmp_path / "r.mcap", Path.open
    record.symlink_to("/dev/full")  # which a recording would not replace
    monkeypatch.setattr(Path, "open", lambda self, mode="r", *more, **named: usual(self, mode.replace("x", "w"), *more, **named))
    with pytest.raises(OSError, match="No space left on device") as full:
        replay(find_drive(drive, None), tmp_path / "out", record=record)
    assert full.value.filename == str(record)


def test_on_a_disk_that_takes_nothing_the_file_itself_is_named(tmp_path: Path) -> None:
    (tmp_path / "shown").mkdir()
    with disk.read_only(tmp_path / "disk", tmp_path / "shown") as folder:
        with pytest.raises(OSError, match="Read-only file system") as refused:
            written(folder / "a.egmap")
        assert refused.value.filename == str(folder / "a.egmap")


def test_a_link_to_nothing_is_not_said_to_be_meant(tmp_path: Path) -> None:
    (tmp_path / "can.log").symlink_to("gone.log")
    assert str(no_file(tmp_path / "can.log")) == f"{tmp_path / 'can.log'}: there is no such file"
    (tmp_path / "can2.log").touch()
    assert str(no_file(tmp_path / "can.log")).endswith(f"; did you mean {tmp_path / 'can2.log'}?")


@pytest.mark.parametrize("line", ["map show /dev/null", "map info /dev/null", "map import /dev/null a.egmap"])
def test_a_device_is_not_called_missing(line: str) -> None:
    given = _parser().parse_args(line.split())
    with pytest.raises(EchogridError, match="^/dev/null: is a device or a pipe, expected a file$"):
        given.command(given)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (f"replay {DEMO} --out note", "note: is a file, expected a folder"),
        (f"replay {DEMO} --out note/below", "note/below: cannot be made: {here}/note is a file"),
        (f"replay {DEMO} --out {'x' * 300}", f"{'x' * 300}: cannot be made: File name too long"),
        (f"replay {DEMO} --publish --out note", "note: is a file, expected a folder"),
        (f"replay {DEMO} --store none/new.egmap", "none/new.egmap: there is no folder none"),
        (f"replay {DEMO} --publish --store new.map", "new.map: is not written, expected a name that ends in .egmap"),
        ("demo --out note", "note: is a file, expected a folder"),
        (f"check -c {DEMO}/echogrid.toml nowhere.log --report page.html", "page.html: is a folder, expected the name of a file"),
        (f"check -c {DEMO}/echogrid.toml nowhere.log --report page", "page: is not written, expected a name that ends in .html"),
        (f"check -c {DEMO}/echogrid.toml nowhere.log --fix-out none/a.toml", "none/a.toml: there is no folder none"),
    ],
)
def test_what_cannot_be_written_is_said_before_anything_is_read(
    line: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("note").write_text("mine")
    Path("page.html").mkdir()
    given = _parser().parse_args(line.split())
    with pytest.raises(EchogridError) as said:
        given.command(given)
    assert str(said.value) == sentence.format(here=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["note", "page.html"]
