"""A simulated car's lidar through a bag, dead reckoning and the label command, beside the simulator's own truth."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.support import agreement as patches
from tests.training.labelling.conftest import bring

from echogrid.core.evidence.raster import GridSpec
from echogrid_training import cli
from echogrid_training.drives.samples import samples
from echogrid_training.labelling.bring import read_turns
from echogrid_training.truth.simulated_truth import SimulatedTruth, load_simulated_truth

SPEC = GridSpec()


def agreement(true: SimulatedTruth, found: SimulatedTruth) -> tuple[float, float]:
    """In the patches around the car every half second."""
    stamps = range(int(found.stamp_ns[0]), int(found.stamp_ns[-1]), 500_000_000)
    poses = [(true.pose(stamp), found.pose(stamp)) for stamp in stamps]
    assert all(there is not None and here is not None for there, here in poses)
    return patches.agreement((true.map.patch(there, SPEC), found.map.patch(here, SPEC)) for there, here in poses)


def test_labels_agree_with_the_simulators_truth(car: Path, labelled: Path) -> None:
    occupied, free = agreement(load_simulated_truth(car / "truth.npz"), load_simulated_truth(labelled / "truth.npz"))
    assert occupied >= 0.9
    assert free >= 0.97


def test_a_network_may_learn_from_it(labelled: Path) -> None:
    found = list(samples(labelled))
    assert found
    assert all((sample.truth != 0).any() and sample.lidar.any() for sample in found)
    assert (labelled / "label.png").stat().st_size > 1000
    report = json.loads((labelled / "label.json").read_text())
    assert report["turns"] + report["without_pose"] == 80


def test_a_folder_of_clouds_gives_the_same_as_the_bag(car: Path, labelled: Path, tmp_path: Path) -> None:
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    for turn in read_turns(labelled):
        np.savez(clouds / f"{turn.stamp_ns}.npz", xyz=turn.cloud().points)
    assert bring(car, clouds, tmp_path / "again") == 0
    for name in ("stamp_ns", "offsets", "xyz_cm"):
        with np.load(tmp_path / "again" / "lidar.npz") as again, np.load(labelled / "lidar.npz") as first:
            np.testing.assert_array_equal(again[name], first[name])


def test_a_wrong_clock_heading_and_height_are_found(labelled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is added to the file comes back with the other sign, beside what the drawn car has by itself."""

    def doubts(lines: str) -> dict[str, str]:
        folder = tmp_path / "wrong"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(labelled, folder)
        (folder / "lidar.toml").write_text(lines)
        assert cli.main(["label", str(folder), "--force"]) == 0
        capsys.readouterr()
        return {one["code"]: one["sentence"] for one in json.loads((folder / "label.json").read_text())["distrust"]}

    assert "z = 1.9" in doubts("x = 1.35\ny = 0\nz = 2.3\n")["height"]
    turned = doubts("x = 1.35\ny = 0\nz = 1.9\nyaw_deg = 3\n")["yaw"]
    assert float(turned.partition("turned by ")[2].partition("°")[0]) == pytest.approx(-3.0, abs=0.8)
    late = doubts("x = 1.35\ny = 0\nz = 1.9\nlatency_ms = 140\n")
    found = float(late["clock"].rpartition("latency_ms = ")[2])
    own = doubts("x = 1.35\ny = 0\nz = 1.9\n").get("clock", "latency_ms = 0")
    assert found == pytest.approx(float(own.rpartition("latency_ms = ")[2]), abs=41)


def test_mistakes_are_one_sentence(car: Path, labelled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "late").mkdir()
    np.savez(tmp_path / "late" / "1900000000000000000.npz", xyz=np.zeros((5, 3)))
    (tmp_path / "named").mkdir()
    np.savez(tmp_path / "named" / "first.npz", xyz=np.zeros((5, 3)))
    (tmp_path / "torn.mcap").write_bytes((car / "lidar.mcap").read_bytes()[:5000])
    out = tmp_path / "out"
    for lidar, expected in (
        (tmp_path / "none", "none: there is no such file or folder with a lidar's recording"),
        (tmp_path / "empty", "empty: holds neither .mcap nor"),
        (tmp_path / "late", " s apart; both need one clock"),
        (tmp_path / "named", "first.npz: expected a name that is the turn's stamp in ns"),
        (tmp_path / "torn.mcap", "torn.mcap: "),
        (car / "can.log.gz", "can.log.gz: expected an .mcap file, or a folder"),
    ):
        assert bring(car, lidar, out) == 1
        printed = capsys.readouterr()
        assert expected in printed.err
        assert printed.err.count("\n") == 1
    assert not out.exists()
    torn = shutil.copytree(car, tmp_path / "torn")
    (torn / "can.log.gz").write_bytes(b"noise")
    assert bring(torn, car / "lidar.mcap", out) == 1
    assert capsys.readouterr().err.startswith(f"{torn / 'can.log.gz'}: holds no CAN message")
    shutil.copytree(labelled, tmp_path / "cars" / "still")
    still = tmp_path / "cars" / "still" / "lidar.npz"
    np.savez(still, stamp_ns=np.zeros(0, np.int64), offsets=np.zeros(1, np.int64), xyz_cm=np.zeros((0, 3), np.int16))
    for arguments, expected in (
        (["label", str(tmp_path / "cars" / "still")], "lidar.npz: holds no turn of the lidar"),
        (["label", str(tmp_path / "cars")], "cars: holds drives with a lidar, expected one of them, such as "),
        (["label", str(tmp_path / "none")], "none: there is no such folder"),
        (["label", str(car)], "train-00000: has no lidar.npz; bring its lidar with: echogrid-train import own"),
        (["label", str(tmp_path / "empty")], "empty: has no lidar.npz; bring its lidar with: echogrid-train import own"),
    ):
        assert cli.main(arguments) == 1
        assert expected in capsys.readouterr().err
