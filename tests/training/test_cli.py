"""The command line: what it prints, and that a mistake is one sentence and not a traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.recordings import make_recording

from echogrid.config.loading import load_config
from echogrid_training import __main__, cli
from echogrid_training.recording import Recording


@pytest.fixture(autouse=True)
def short_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole demonstration takes seconds, and is none of this file's business."""

    def drive(*_: object, **__: object) -> Recording:
        return make_recording()

    monkeypatch.setattr(cli, "drive", drive)


def test_a_scene_is_written_and_summed_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["scene", "--out", str(tmp_path / "drive"), "--classic"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert "40 cycles of 4 radars" in out
    assert "860 detections sent, 0 beyond the nearest 64 of their cycle left out, 0 left out since a value does not fit" in out
    assert load_config(tmp_path / "drive" / "echogrid.toml").radar[3].profile == "corner_radar_classic"


def test_mistakes_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "note").write_text("")
    (tmp_path / "bad.npz").write_text("bad")
    (tmp_path / "noise.txt").write_bytes(b"\x1f\x8b\x08")
    out = str(tmp_path / "out")
    for arguments, expected in (
        (["import", "nuscenes", str(tmp_path / "none"), "--out", out], "none: does not exist"),
        (["import", "nuscenes", str(tmp_path / "bad.npz"), "--out", out], "bad.npz: is not an .npz file of arrays"),
        (["import", "many", str(tmp_path / "none.txt")], "none.txt: cannot be read: No such file"),
        (["import", "many", str(tmp_path / "noise.txt")], "noise.txt: is not a text in UTF-8: invalid start byte at byte 1"),
        (["import", "radarscenes", str(tmp_path / "full"), "--out", out], "radar_data.h5: does not exist"),
        (["scene", "--out", str(tmp_path / "full")], "full: is not empty"),
        (["scene", "--out", str(tmp_path / "bad.npz")], "bad.npz: is a file, expected a folder"),
        (["scene", "--out", str(tmp_path / "bad.npz" / "below")], "below: cannot be made: "),
    ):
        assert cli.main(arguments) == 1
        printed = capsys.readouterr()
        assert printed.out == ""
        assert expected in printed.err
        assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_nothing_here_needs_torch() -> None:
    """Drives are made on machines that train nothing."""
    code = "import sys; sys.modules['torch'] = None; import echogrid_training.cli"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_ctrl_c_is_130_whenever_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    """While the program is loading too, which nothing inside it could catch."""
    monkeypatch.setitem(sys.modules, "asammdf", None)  # set back afterwards

    def stopped() -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "main", stopped)
    with pytest.raises(SystemExit) as ended:
        __main__.run()
    assert ended.value.code == 130
