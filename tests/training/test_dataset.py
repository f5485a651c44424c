"""Cached samples of drives, the split by towns, and the augmentation."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.training.tiny_towns import room, town, track

from echogrid.errors import EchogridError
from echogrid_training.dataset import augment, find_drives, load_drive, load_drives, packed, soft, split, ternary
from echogrid_training.drive import write_drive
from echogrid_training.episode import paper_like
from echogrid_training.ground_truth import soft as true_soft
from echogrid_training.ground_truth import ternary as true_ternary
from echogrid_training.samples import samples
from echogrid_training.simulate import simulate


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset") / "train-00000"
    recording, truth = simulate(town(*room(28.0, 14.0), ego=track(1.5, speed=3.0)), paper_like(2))
    write_drive(recording, folder, truth_map=truth)
    return folder


def names(folder: Path, *drives: str) -> list[Path]:
    return [folder / name for name in drives]


def test_kept_samples_are_those_of_the_drive(drive: Path) -> None:
    expected = list(samples(drive))
    held = load_drive(drive)
    images, labels = held.batch(np.arange(len(held)))
    assert len(held) == len(expected) > 3
    for image, label, sample in zip(images, labels, expected, strict=True):
        np.testing.assert_array_equal(image, sample.image[0])
        np.testing.assert_array_equal(ternary(label), true_ternary(sample.truth))
        np.testing.assert_allclose(soft(label), true_soft(sample.truth), atol=0.5 / 127 + 1e-6)


def test_evidence_that_nearly_cancels_is_still_observed() -> None:
    log_odds = np.array((0.0, np.finfo(np.float32).tiny, -1e-6, 6.0), dtype=np.float32)
    truth = np.tile(log_odds, (128, 32))
    held = packed([(np.ones((1, 128, 128), np.float32), truth)])
    np.testing.assert_array_equal(ternary(held.labels[0, 0, :4]), (0, 1, -1, 1))


def test_samples_are_cut_anew_only_when_the_drive_changes(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = tmp_path / drive.name
    shutil.copytree(drive, copy)
    first = load_drive(copy)
    cut: list[Path] = []

    def counted(folder: Path) -> list[object]:
        cut.append(folder)
        return list(samples(folder))

    monkeypatch.setattr("echogrid_training.samples.samples", counted)
    assert load_drive(copy).digest() == first.digest()
    assert cut == []
    config = copy / "echogrid.toml"
    config.write_text(config.read_text() + "\n[map]\nclamp = 3.0\n")
    assert load_drive(copy).digest() == first.digest()
    assert cut == [copy]
    kept = tmp_path / "train-00000.samples.npz"
    kept.write_bytes(kept.read_bytes()[:1000])  # torn
    assert load_drives([copy])[0].digest() == first.digest()
    assert cut == [copy, copy]


def test_a_drive_of_another_grid_is_refused(drive: Path, tmp_path: Path) -> None:
    copy = tmp_path / drive.name
    shutil.copytree(drive, copy)
    config = copy / "echogrid.toml"
    config.write_text(config.read_text() + "\n[grid]\ncells = 64\n")
    with pytest.raises(EchogridError, match=r"echogrid.toml: grid of 64 cells of 0.234375 m found, expected 128 of 0.234375"):
        load_drive(copy)


def test_drives_are_found_however_deep(tmp_path: Path) -> None:
    for name in ("b/train-00001", "a/train-00000", "a/.train-00002.partial"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "truth.npz").touch()
    assert find_drives(tmp_path) == [tmp_path / "a/train-00000", tmp_path / "b/train-00001"]
    with pytest.raises(EchogridError, match="there is no such folder"):
        find_drives(tmp_path / "c")
    (tmp_path / "empty").mkdir()
    with pytest.raises(EchogridError, match="holds no simulated drives"):
        find_drives(tmp_path / "empty")


def test_towns_are_split_and_more_towns_do_not_move_the_others(tmp_path: Path) -> None:
    few = names(tmp_path, *(f"train-{index:05d}" for index in range(100)))
    many = names(tmp_path, *(f"train-{index:05d}" for index in range(400)))
    learned, held_out = split(few)
    assert sorted(learned + held_out) == few
    assert 5 <= len(held_out) <= 22
    more_learned, more_held_out = split(many)
    assert set(learned) <= set(more_learned)
    assert set(held_out) <= set(more_held_out)
    assert [len(part) for part in split(few[:1])] == [1, 0]
    for count in range(2, 12):
        assert all(split(few[:count]))


def test_drives_through_one_extract_stay_together(tmp_path: Path) -> None:
    for place in ("helsinki", "turku", "oulu"):
        (tmp_path / place).mkdir()
        plan = {"family": "osm", "towns": 5, "seconds": 40.0, "seed": 1, "osm": f"{place}.osm"}
        (tmp_path / place / "campaign.json").write_text(json.dumps(plan))
    drives = [tmp_path / place / f"osm-{index:05d}" for place in ("helsinki", "turku", "oulu") for index in range(5)]
    learned, held_out = split(drives)
    assert not {drive.parent for drive in learned} & {drive.parent for drive in held_out}
    assert len(learned) + len(held_out) == 15
    assert learned
    assert held_out


def test_augmentation_turns_image_and_label_alike_in_all_eight_ways() -> None:
    rng = np.random.default_rng(3)
    image = rng.choice(np.array((-1, 1), dtype=np.int8), size=(128, 128))
    label = (image * 100 + rng.integers(-20, 20, size=image.shape)).astype(np.int8)  # of the image's sign everywhere
    ways = {np.rot90(flipped, turn).tobytes() for flipped in (image, image[::-1]) for turn in range(4)}
    images, labels = augment(np.stack([image] * 200), np.stack([label] * 200), np.random.default_rng(1))
    np.testing.assert_array_equal(np.sign(labels), images)
    found = [one.tobytes() for one in images]
    assert set(found) == ways
    assert len(ways) == 8
    assert min(found.count(way) for way in ways) > 8
