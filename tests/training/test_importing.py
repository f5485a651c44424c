"""Many imports from one file: an import a line, restartable, the same files with any number of workers."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.nuscenes_files import two_samples, write_compact

from echogrid_training import cli


@pytest.fixture
def lines(tmp_path: Path) -> Path:
    """Three scenes, one of them in a folder with a blank in its name."""
    (tmp_path / "two words").mkdir()
    for path in ("scene-0001.npz", "scene-0002.npz", "two words/scene-0003.npz"):
        write_compact(two_samples(), tmp_path / path)
    text = f"""# scenes
nuscenes {tmp_path}/scene-0001.npz --out {tmp_path}/out/a

nuscenes {tmp_path}/scene-0002.npz --out {tmp_path}/out/b --classic   # narrow
nuscenes '{tmp_path}/two words/scene-0003.npz' --out {tmp_path}/out/c
"""
    (tmp_path / "drives.txt").write_text(text)
    return tmp_path / "drives.txt"


def content(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*") if path.is_file()}


def test_every_line_is_an_import_whoever_does_it(lines: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert cli.main(["import", "many", str(lines), "--workers", "1"]) == 0
    here = content(out)
    assert {Path(name).parent.name for name in here} == {"a", "b", "c"}
    assert "fd = false" in here["b/echogrid.toml"].decode()
    out.rename(tmp_path / "before")
    partial = out / ".a.partial"  # of a run that was killed
    partial.mkdir(parents=True)
    (partial / "can.log.gz").write_bytes(b"torn")
    (tmp_path / "before" / "c").rename(out / "c")
    stamp = (out / "c" / "can.log.gz").stat().st_mtime_ns
    capsys.readouterr()
    assert cli.main(["import", "many", str(lines), "--workers", "2"]) == 0
    assert content(out) == here
    assert (out / "c" / "can.log.gz").stat().st_mtime_ns == stamp
    assert "out/c: is there already" in capsys.readouterr().out


def test_a_cluster_gives_the_same(lines: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    assert cli.main(["import", "many", str(lines), "--workers", "1"]) == 0
    here = content(tmp_path / "out")
    (tmp_path / "out").rename(tmp_path / "before")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=None
    ) as cluster:
        assert cli.main(["import", "many", str(lines), "--scheduler", cluster.scheduler_address]) == 0
    assert content(tmp_path / "out") == here


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nuscenes a.npz\n", "line 1: the following arguments are required: --out"),
        ("\nwaymo a --out b\n", "line 2: argument DATASET: invalid choice: 'waymo'"),
        ("nuscenes a.npz --out b\nnuscenes c.npz --out b\n", "line 2: "),
        ("nuscenes 'a.npz --out b\n", "line 1: No closing quotation"),
        ("many other.txt\n", "line 1: argument DATASET: invalid choice: 'many'"),
        ("# nothing\n", "holds no line that imports something"),
        ("nuscenes none.npz --out b\nradarscenes gone.npz --out c\n", "2 of 2 failed: "),
    ],
)
def test_a_line_that_is_wrong_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, expected: str) -> None:
    (tmp_path / "drives.txt").write_text(text)
    assert cli.main(["import", "many", str(tmp_path / "drives.txt"), "--workers", "1"]) == 1
    printed = capsys.readouterr()
    assert expected in printed.err
    assert printed.err.count("\n") == 1
