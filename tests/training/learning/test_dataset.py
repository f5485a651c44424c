"""Cached samples of drives, the split by towns, and the augmentations."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.support.places import ROOT
from tests.support.tiny_drives import room_drive
from tests.support.tiny_towns import track

from echogrid.core.motion.se2 import IDENTITY
from echogrid.errors import EchogridError
from echogrid_training.drives.samples import Sample, samples
from echogrid_training.learning.dataset import (
    SPEC,
    Samples,
    find_drives,
    joined,
    load_drive,
    load_drives,
    mirrored,
    of_detections,
    of_lidar,
    packed,
    read_samples,
    soft,
    split,
    ternary,
    turned,
)
from echogrid_training.truth.ground_truth import soft as true_soft
from echogrid_training.truth.ground_truth import ternary as true_ternary
from echogrid_training.truth.simulated_truth import load_simulated_truth


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Off the middle of its room and askew, so that nothing looks like its mirror image."""
    folder = tmp_path_factory.mktemp("dataset") / "train-00000"
    return room_drive(folder, track(1.5, speed=3.0, x=-5.0, y=2.0, yaw=0.1))


def names(folder: Path, *drives: str) -> list[Path]:
    return [folder / name for name in drives]


def test_kept_samples_are_those_of_the_drive(drive: Path) -> None:
    """Cut anew, then read back from beside the drive."""
    expected = list(samples(drive))
    for held in (load_drive(drive), load_drive(drive)):
        assert len(held) == len(expected) > 3
        for index, sample in enumerate(expected):
            np.testing.assert_array_equal(held.images[index], sample.image)
            np.testing.assert_array_equal(of_lidar(held.lidar)[index, 0], np.where(sample.lidar > 0, 1.0, -1.0))
            np.testing.assert_array_equal(ternary(held.labels[index]), true_ternary(sample.truth))
            np.testing.assert_allclose(soft(held.labels[index]), true_soft(sample.truth), atol=0.5 / 127 + 1e-6)
    assert of_lidar(held.lidar).shape == of_detections(held.images).shape == (len(expected), 1, 128, 128)
    np.testing.assert_array_equal(of_detections(held.images)[:, 0] == 1.0, held.images[:, 0] > 0)


def test_no_sample_of_the_drive_looks_like_its_mirror_image(drive: Path) -> None:
    """What the comparison above hangs on: labels that were turned over would not pass it."""
    labels = load_drive(drive).labels
    for mirrored_labels in (labels[:, ::-1], labels[:, :, ::-1], labels.transpose(0, 2, 1)):
        different = (np.sign(labels) != np.sign(mirrored_labels)).mean(axis=(1, 2))
        assert different.min() > 0.02


def test_evidence_that_nearly_cancels_is_still_observed() -> None:
    log_odds = np.array((0.0, np.finfo(np.float32).tiny, -1e-6, 6.0), dtype=np.float32)
    truth = np.zeros((128, 128), np.float32)
    truth[3, 8:12] = log_odds
    held = packed([Sample(0, np.zeros((128, 128), np.uint8), np.zeros((12, 128, 128), np.uint8), truth, IDENTITY)])
    np.testing.assert_array_equal(ternary(held.labels[0, 3, 8:12]), (0, 1, -1, 1))
    assert np.count_nonzero(held.labels) == 3
    assert len(packed([])) == 0


def random_samples(count: int, seed: int) -> Samples:
    rng = np.random.default_rng(seed)
    images, lidar = (rng.integers(0, 256, shape).astype(np.uint8) for shape in ((count, 12, 128, 128), (count, 2048)))
    return Samples(images, lidar, rng.integers(-127, 128, (count, 128, 128)).astype(np.int8))


def test_joined_and_chosen_are_the_parts_in_order() -> None:
    parts = [random_samples(count, count) for count in (2, 0, 3)]
    whole = joined(parts)
    assert len(whole) == 5
    for start, part in ((0, parts[0]), (2, parts[2])):
        again = whole.chosen(np.arange(start, start + len(part)))
        assert again.digest() == part.digest()
    assert whole.chosen(np.array([4, 0])).images[1].tobytes() == parts[0].images[0].tobytes()
    digests = {whole.digest()}
    for array in (whole.images, whole.lidar, whole.labels):
        array[1, 5] += 1
        digests.add(whole.digest())
    assert len(digests) == 4


def test_samples_are_cut_anew_only_when_the_drive_changes(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = tmp_path / drive.name
    shutil.copytree(drive, copy)
    first = load_drive(copy)
    cut: list[Path] = []

    def counted(folder: Path, disturbance: object, *, whole: bool) -> list[Sample]:
        assert disturbance is None
        assert not whole
        cut.append(folder)
        return list(samples(folder))

    monkeypatch.setattr("echogrid_training.drives.samples.samples", counted)
    assert load_drive(copy).digest() == first.digest()
    assert cut == []
    config = copy / "echogrid.toml"
    config.write_text(config.read_text() + "\n[map]\nclamp = 3.0\n")
    assert load_drive(copy).digest() == first.digest()
    assert cut == [copy]
    kept = tmp_path / "train-00000.samples.npz"
    kept.write_bytes(kept.read_bytes()[:1000])  # torn
    assert load_drives([copy]).digest() == first.digest()
    assert cut == [copy, copy]


def test_a_drive_is_found_from_within(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose folder is where the command is typed, or the one above: what is kept beside it is the same file."""
    copy = tmp_path / drive.name
    (copy / "below").mkdir(parents=True)
    shutil.copytree(drive, copy, dirs_exist_ok=True)
    first = load_drive(copy)
    monkeypatch.setattr("echogrid_training.drives.samples.samples", lambda *_, **__: pytest.fail("it was cut anew"))
    for place, path in ((copy, "."), (copy / "below", "..")):
        monkeypatch.chdir(place)
        assert load_drive(Path(path)).digest() == first.digest()
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == [f"{drive.name}.samples.npz"]


def test_disturbed_samples_are_kept_beside_the_others(drive: Path, tmp_path: Path) -> None:
    """Which disturbance hangs on the drive's name alone; several processes cut what one would."""
    copies = [tmp_path / f"train-{index:05d}" for index in range(2)]
    for copy in copies:
        shutil.copytree(drive, copy)
    whole = load_drives(copies, disturbed=True, workers=2)
    assert {path.name for path in tmp_path.glob("*.npz")} == {f"train-0000{index}.disturbed.npz" for index in range(2)}
    shutil.rmtree(tmp_path / "train-00001")
    shutil.copytree(drive, tmp_path / "again" / "train-00001")
    one = load_drive(tmp_path / "again" / "train-00001", disturbed=True)
    assert one.digest() == whole.chosen(np.arange(len(whole) - len(one), len(whole))).digest()
    assert one.digest() != load_drive(tmp_path / "again" / "train-00001").digest()


def test_whole_samples_have_the_papers_labels_and_are_kept_apart(drive: Path) -> None:
    """The true map's patch at the sample's pose, by a look-up of its own; the other samples tell less of it and nothing else."""
    truth = load_simulated_truth(drive / "truth.npz")
    told, cut = load_drive(drive), list(samples(drive))
    for _ in range(2):  # cut, and read back
        held = load_drives([drive], whole=True)
        for index, sample in enumerate(cut):
            patch = truth.map.patch(sample.truth_from_base, SPEC)
            np.testing.assert_array_equal(ternary(held.labels[index]), np.sign(patch))
        known = told.labels != 0
        np.testing.assert_array_equal(held.labels[known], told.labels[known])
        assert np.count_nonzero(held.labels) > 1.03 * np.count_nonzero(known)
        np.testing.assert_array_equal(held.images, told.images)


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
    assert len(find_drives(tmp_path / "a" / "..")) == 2  # what hides is below the folder, not on the way to it
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


def test_the_papers_augmentation_turns_image_and_label_alike_in_all_eight_ways() -> None:
    rng = np.random.default_rng(3)
    image = rng.choice(np.array((-1, 1), dtype=np.float32), size=(1, 128, 128))
    label = (image[0] * (100 + rng.integers(-20, 20, size=image[0].shape))).astype(np.int8)  # of the image's sign everywhere
    ways = {np.rot90(flipped, turn).tobytes() for flipped in (image[0], image[0, ::-1]) for turn in range(4)}
    before = image.copy(), label.copy()
    images, labels = turned(np.stack([image] * 200), np.stack([label] * 200), np.random.default_rng(1))
    np.testing.assert_array_equal(np.sign(labels), images[:, 0])
    found = [one.tobytes() for one in images]
    assert set(found) == ways
    assert len(ways) == 8
    assert min(found.count(way) for way in ways) > 8
    np.testing.assert_array_equal(image, before[0])
    np.testing.assert_array_equal(label, before[1])


def test_left_for_right_turns_planes_and_labels_alike_in_half_of_the_pairs() -> None:
    some = random_samples(40, 1)
    images, labels = mirrored(some.images, some.labels, np.random.default_rng(1))
    flipped = 0
    for image, label, old_image, old_label in zip(images, labels, some.images, some.labels, strict=True):
        if image.tobytes() != old_image.tobytes():
            flipped += 1
            old_image, old_label = old_image[:, ::-1], old_label[::-1]
        np.testing.assert_array_equal(image, old_image)
        np.testing.assert_array_equal(label, old_label)
    assert 10 < flipped < 30


def documented() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Type and shape of each array by docs/simulator.md."""
    text = (ROOT / "docs" / "simulator.md").read_text("utf-8").split("## Samples")[1].split("\n## ")[0]
    rows = re.findall(r"(?m)^\| `(\w+)` \| (\w+) \| \((.*?)\) \|", text)
    return {name: (kind, tuple(part.strip() for part in shape.split(",") if part.strip())) for name, kind, shape in rows}


def test_a_file_of_samples_is_as_its_documentation_says(drive: Path) -> None:
    """Read without a line of ours."""
    cut, layout = list(samples(drive)), documented()
    load_drive(drive)
    with np.load(drive.with_name("train-00000.samples.npz")) as held:
        assert set(held.files) == set(layout)
        for name, (kind, shape) in layout.items():
            assert held[name].dtype.kind == "U" if kind == "text" else held[name].dtype == kind
            assert [str(size) for size in held[name].shape] == [str(len(cut)) if size == "N" else size for size in shape]
        for packed, labels, sample in zip(held["lidar"], held["labels"], cut, strict=True):
            bits = [[(packed[(128 * i + j) // 8] >> (7 - (128 * i + j) % 8)) & 1 for j in range(128)] for i in range(128)]
            np.testing.assert_array_equal(bits, sample.lidar)
            exact = 127 * np.tanh(sample.truth / 2)
            assert np.abs(labels - exact).max() <= 1
            np.testing.assert_array_equal(np.sign(labels), np.sign(sample.truth))
        i, j = np.nonzero(bits)
        around = load_simulated_truth(drive / "truth.npz").lidar_points(cut[-1].stamp_ns, cut[-1].truth_from_base)
        near = around[(np.abs(around) < 15).all(axis=1)]
        size = 0.234375
        found = np.stack((-15 + size * (j + 0.5), -15 + size * (i + 0.5)), axis=-1)
        away = np.abs(found[:, None] - near).max(axis=-1)
        assert away.min(axis=1).max() <= size / 2 + 1e-6  # each such cell has a return in it
        assert away.min(axis=0).max() <= size / 2 + 1e-6  # and each return is in one


def test_samples_are_appended_by_another_file(drive: Path, tmp_path: Path) -> None:
    ours = load_drive(drive)
    rng = np.random.default_rng(1)
    images, labels = rng.integers(0, 256, (5, 12, 128, 128), np.uint8), rng.integers(-128, 128, (5, 128, 128)).astype(np.int8)
    np.savez(tmp_path / "more.npz", images=images, lidar=np.zeros((5, 2048), np.uint8), labels=labels)
    both = joined([load_drives([drive]), read_samples(tmp_path / "more.npz")])
    assert len(both) == len(ours) + 5
    np.testing.assert_array_equal(both.images[: len(ours)], ours.images)
    np.testing.assert_array_equal(both.labels[len(ours) :], labels)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"labels": np.zeros((5, 128, 128))}, "'labels' is float64 of shape (5, 128, 128), expected int8 of (N, 128, 128)"),
        (
            {"images": np.zeros((4, 12, 128, 128), np.uint8)},
            "'images' is uint8 of shape (4, 12, 128, 128), expected uint8 of (N, 12, 128, 128)",
        ),
        ({"lidar": np.zeros((5, 128, 128), np.uint8)}, "'lidar' is uint8 of shape (5, 128, 128), expected uint8 of (N, 2048)"),
        ({"labels": None}, "has no array 'labels', found images, lidar"),
    ],
)
def test_a_file_of_other_arrays_is_one_sentence(tmp_path: Path, change: dict[str, np.ndarray | None], expected: str) -> None:
    arrays = {
        "images": np.zeros((5, 12, 128, 128), np.uint8),
        "lidar": np.zeros((5, 2048), np.uint8),
        "labels": np.zeros((5, 128, 128), np.int8),
    }
    np.savez(tmp_path / "more.npz", **{name: array for name, array in (arrays | change).items() if array is not None})
    with pytest.raises(EchogridError, match=re.escape(f"more.npz: {expected}")):
        read_samples(tmp_path / "more.npz")
