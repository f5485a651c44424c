"""True poses: what is no such file is one sentence, however it is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from echogrid.errors import EchogridError
from echogrid.logs import drive
from echogrid.logs.drive import find_drive, load_truth

GOOD = {"stamp_ns": np.arange(4), "x": np.arange(4.0), "y": np.ones(4), "yaw": np.zeros(4)}
MAP = {"log_odds": np.ones((2, 3)), "origin": np.array([1.0, -2.0])}


def test_poses_and_the_map_are_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "truth.npz", **GOOD, **MAP)
    truth = load_truth(tmp_path / "truth.npz")
    assert truth is not None
    assert truth.map is not None
    np.testing.assert_array_equal(truth.poses, np.stack([GOOD["x"], GOOD["y"], GOOD["yaw"]], axis=1))
    assert (truth.stamp_ns.dtype, truth.map.log_odds.shape, truth.map.origin) == (np.int64, (2, 3), (1.0, -2.0))


def test_a_folder_with_a_recording_of_another_name_is_told_how_to_give_it(tmp_path: Path) -> None:
    for name in ("trajectory.csv", "notes.txt"):
        (tmp_path / name).touch()
    with pytest.raises(EchogridError, match=r"holds no recording, expected one of can\.log\.gz, .* can\.db$"):
        find_drive(tmp_path, None)
    for name in ("monday.blf", "monday.log.gz"):
        (tmp_path / name).touch()
    with pytest.raises(EchogridError, match=r"holds no recording, .*; \S+monday\.blf is taken by its own name, with -c$"):
        find_drive(tmp_path, None)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"x": np.zeros(3)}, "their lengths differ"),
        ({"x": np.zeros((4, 2)), "y": np.zeros((4, 2)), "yaw": np.zeros((4, 2))}, "their lengths differ"),
        ({"x": np.array(["a"] * 4)}, "could not convert"),
        ({name: np.zeros(0) for name in GOOD}, "expected at least one pose, finite numbers, and times that do not go back"),
        ({"yaw": np.array([0.0, np.nan, 0.0, 0.0])}, "expected at least one pose, finite numbers, and times that do not go back"),
        ({"stamp_ns": np.array([0, 2, 1, 3])}, "expected at least one pose, finite numbers, and times that do not go back"),
        ({"log_odds": np.ones(3), "origin": np.zeros(2)}, "the map log_odds is not two-dimensional"),
        ({"yaw": np.zeros(1 << 12)}, "it unpacks to "),
    ],
)
def test_what_does_not_fit_is_one_sentence(
    tmp_path: Path, change: dict[str, np.ndarray], complaint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drive, "MOST_BYTES", 1 << 14)
    path = tmp_path / "truth.npz"
    np.savez_compressed(path, **(GOOD | change))
    with pytest.raises(EchogridError) as caught:
        load_truth(path)
    assert str(caught.value).startswith(f"{path}: is not a truth file with the arrays stamp_ns, x, y and yaw: ")
    assert complaint in str(caught.value)
