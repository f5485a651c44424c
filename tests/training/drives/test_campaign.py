"""Campaigns: the same drives for any number of workers, gone on with after a kill, and looked at."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.support.recordings import make_recording

from echogrid.commands.replay import replay
from echogrid.config.loading import load_config
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid_training.drives import campaign, inspect_drive
from echogrid_training.drives.campaign import Campaign

PLAN = Campaign("train", towns=2, seconds=5.0, seed=7)


def digest(folder: Path) -> dict[str, str]:
    """Of every file, truth.npz by its arrays: a zip holds the time of writing."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".npz":
            with np.load(path) as file:
                content = b"".join(file[key].tobytes() for key in sorted(file.files))
        elif path.is_file():
            content = path.read_bytes()
        else:
            continue
        found[str(path.relative_to(folder))] = hashlib.sha256(content).hexdigest()
    return found


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("campaign")
    heard: list[str] = []
    assert campaign.run(PLAN, out, workers=2, on_done=heard.append) == 2
    assert sorted(heard) == ["train-00000", "train-00001"]
    return out


def test_one_worker_makes_what_two_made_and_goes_on_where_a_killed_run_was(drives: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    shutil.copytree(drives, out)
    shutil.rmtree(out / "train-00001")
    (out / ".train-00001.partial").mkdir()  # what a kill leaves behind
    assert campaign.run(PLAN, out, workers=1, on_done=lambda _: None) == 1
    assert digest(out) == digest(drives)


def test_no_drive_is_ever_without_the_note_of_what_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C right behind a drive: other settings do not go on among its drives. A note without any drive binds nobody."""

    def stopped(name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(campaign, "simulate", lambda *_: (make_recording(), None))
    with pytest.raises(KeyboardInterrupt):
        campaign.run(PLAN, tmp_path, 1, on_done=stopped)
    with pytest.raises(EchogridError, match="holds a campaign with seconds 5"):
        campaign.run(replace(PLAN, seconds=6.0), tmp_path, 1, lambda _: None)
    shutil.rmtree(tmp_path / "train-00000")
    assert campaign.run(replace(PLAN, seconds=6.0, towns=1), tmp_path, 1, lambda _: None) == 1


def test_more_towns_are_added_and_another_campaign_is_refused(drives: Path) -> None:
    with pytest.raises(EchogridError, match=r"campaign.json: the folder holds a campaign with seed 7, expected 8"):
        campaign.run(Campaign("train", 2, 5.0, seed=8), drives, 1, lambda _: None)
    with pytest.raises(EchogridError, match=r"campaign.json: the folder holds a campaign with sensors drawn, expected paper"):
        campaign.run(Campaign("train", 2, 5.0, seed=7, sensors="paper"), drives, 1, lambda _: None)
    (drives / "torn").mkdir()
    (drives / "torn" / "campaign.json").write_text("{")
    with pytest.raises(EchogridError, match="does not note a campaign"):
        campaign.run(PLAN, drives / "torn", 1, lambda _: None)
    shutil.rmtree(drives / "torn")


def test_a_drive_goes_through_the_service_and_can_be_looked_at(drives: Path, tmp_path: Path) -> None:
    summary = replay(find_drive(drives / "train-00000", None), tmp_path / "map")
    assert summary["bad_frames"] == 0
    assert summary["cycles"] > 50
    picture, animation = inspect_drive.inspect(drives / "train-00000", tmp_path / "look")
    with Image.open(animation) as film:
        assert getattr(film, "n_frames", 1) >= 5
    with Image.open(picture) as image:
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 24)}
    assert {inspect_drive.STATIC, inspect_drive.PATH, (0, 0, 0) if (0, 0, 0) in colours else (1, 1, 1)} <= colours | {(1, 1, 1)}


def test_what_is_no_simulated_drive_is_said(tmp_path: Path) -> None:
    with pytest.raises(EchogridError, match="there is no such file or folder"):
        inspect_drive.inspect(tmp_path / "nothing", tmp_path)


def test_the_papers_sensors_drive_through_the_same_town(drives: Path, tmp_path: Path) -> None:
    """Corner radars at +-45 and +-135 degrees, and the very lidar truth of the drawn car's town where both have been."""
    campaign.run(Campaign("train", 1, 5.0, seed=7, sensors="paper"), tmp_path, 1, lambda _: None)
    config = load_config(tmp_path / "train-00000" / "echogrid.toml")
    assert [round(radar.yaw_deg) for radar in config.radar] == [45, -45, 135, -135]
    with np.load(tmp_path / "train-00000" / "truth.npz") as one, np.load(drives / "train-00000" / "truth.npz") as other:
        np.testing.assert_allclose([one[key][0] for key in ("x", "y", "yaw")], [other[key][0] for key in ("x", "y", "yaw")], atol=1e-9)
        assert one["log_odds"].shape == other["log_odds"].shape
