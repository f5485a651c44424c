"""The command, on copies of one tiny drive: it trains the four, and writes a page that needs nothing beside it."""

from __future__ import annotations

import argparse
import base64
import hashlib
import json
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.waiting import PATIENCE

from echogrid.errors import EchogridError
from echogrid_training.learning.dataset import load_drive, ternary
from echogrid_training.learning.train import load_trained
from echogrid_training.paper import material, reproduce
from echogrid_training.truth import ground_truth

pytestmark = pytest.mark.usefixtures("tiny")
NAMES = ("lidar-inverse-3", "lidar-independent-3", "radar-inverse-3", "radar-independent-3")


def run(drives: Path, out: Path, *more: str, test: str = "test") -> str:
    parser = argparse.ArgumentParser()
    reproduce.add_arguments(parser)
    given = ["--drives", drives / "learn", "--test", drives / test, "--out", out, "--small", "--seed", "3", "--workers", "1", *more]
    return reproduce.run(parser.parse_args(list(map(str, given))))


@pytest.fixture(scope="module")
def made(drives: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder, and what the command says."""
    out = tmp_path_factory.mktemp("out")
    return out, run(drives, out)


class Seen(HTMLParser):
    """Tags, and the pictures' sources by name."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.pictures: dict[str, str] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag == "img":
            self.pictures[str(dict(attrs)["alt"])] = str(dict(attrs)["src"])


def test_the_page_holds_the_pictures_that_stand_beside_it(made: tuple[Path, str]) -> None:
    out, _ = made
    page = (out / "reproduction.html").read_text("utf-8")
    seen = Seen()
    seen.feed(page)
    assert not seen.tags & {"script", "link", "iframe"}
    assert page.count("<style>") == 1
    assert "://" not in page
    maps = {f"map-{rule}-{name}" for rule in ("endless", "sum", "looks") for name in NAMES}
    curves = {f"curves-{name}" for name in ("loss", "free", "unknown", "occupied")}
    assert seen.pictures.keys() == maps | curves | {"scene-1", "prior", "map-truth"}
    assert {path.stem for path in out.glob("*.png")} == seen.pictures.keys()
    for name, source in seen.pictures.items():
        assert base64.b64decode(source.removeprefix("data:image/png;base64,")) == (out / f"{name}.png").read_bytes()


def test_four_networks_learn_from_their_sensor_by_their_weights(made: tuple[Path, str]) -> None:
    out, _ = made
    assert {path.name for path in out.iterdir() if path.is_dir()} == set(NAMES)
    for name in NAMES:
        trained = load_trained(out / name / "model.pt")
        assert (trained.settings.sensor, trained.settings.weighting, "3") == tuple(name.split("-"))
        assert (trained.settings.l2, trained.settings.labels) == ("loss", "ternary")
        assert (trained.settings.network, trained.settings.seed, trained.settings.epochs) == ("paper", 3, 1)
    heads = [load_trained(out / name / "model.pt").weights["head.weight"] for name in NAMES]
    assert not any(torch.equal(one, other) for index, one in enumerate(heads) for other in heads[:index])


def test_the_table_judges_the_test_drive(made: tuple[Path, str], drives: Path) -> None:
    """The same errors from the drive's labels and the network's answers, pixel by pixel in numpy."""
    out, said = made
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in said.splitlines() if line.startswith("|")]
    rows, claims = rows[:6], rows[6:]
    assert len(claims) == 6
    assert [row[:4] for row in rows[2:]] == [
        ["lidar", "inverse class ratio", "0.14", "1.46"],
        ["lidar", "independent class MSE", "0.49", "0.55"],
        ["radar", "inverse class ratio", "0.19", "1.82"],
        ["radar", "independent class MSE", "0.70", "0.69"],
    ]
    test = load_drive(drives / "test" / "c", whole=True)
    label = ternary(test.labels)
    for name, row in zip(NAMES, rows[2:], strict=True):
        trained = load_trained(out / name / "model.pt")
        image, _ = trained.recipe().shown(test)
        answer = ground_truth.soft(trained.model()(image).numpy())
        for sign, cell in zip((-1, 0, 1), row[4:7], strict=True):
            assert float(cell.split()[0]) == pytest.approx(((answer - label)[label == sign] ** 2).mean(), abs=1e-3)
    page = (out / "reproduction.html").read_text("utf-8")
    assert all(cell in page for row in rows[2:] for cell in row)


def test_what_is_done_is_not_done_again(made: tuple[Path, str], drives: Path) -> None:
    out, said = made
    page = (out / "reproduction.html").read_text("utf-8")
    with pytest.raises(EchogridError, match="lidar-inverse-3: holds a run; continue it with --resume"):
        run(drives, out)
    assert run(drives, out, "--resume") == said
    assert (out / "reproduction.html").read_text("utf-8") == page


def test_the_page_says_what_it_was_made_of(made: tuple[Path, str], drives: Path) -> None:
    page = (made[0] / "reproduction.html").read_text("utf-8")
    samples = len(load_drive(drives / "test" / "c", whole=True))
    test = load_drive(drives / "test" / "c", whole=True)
    assert re.search(
        rf"<td>test</td><td class=number>1</td><td class=number>{samples}</td><td>not noted</td><td>{test.digest()}</td>", page
    )
    assert load_trained(made[0] / "radar-inverse-3" / "model.pt").data_sha256 in page
    held = json.loads((made[0] / "reproduction.json").read_text("utf-8"))
    for name in NAMES:
        digest = hashlib.sha256((made[0] / name / "model.pt").read_bytes()).hexdigest()
        assert digest in page
        assert held["networks"][name]["sha256"] == digest
    assert (held["settings"]["seed"], held["settings"]["l2"]) == (3, "loss")
    assert held["parts"]["test"]["drives"] == ["c"]


def test_the_four_are_shown_the_same_drives_without_disturbance(made: tuple[Path, str], drives: Path) -> None:
    assert {path.name for path in drives.rglob("*.npz")} == {
        "truth.npz",
        "a.samples.whole.npz",
        "b.samples.whole.npz",
        "c.samples.whole.npz",
    }
    logs = [json.loads((made[0] / name / "log.jsonl").read_text()) for name in NAMES]
    assert len({log["step"] for log in logs}) == 1


def test_two_seeds_are_two_networks_of_each_kind(drives: Path, tmp_path: Path) -> None:
    said = run(drives, tmp_path, "--seeds", "2", "--labels", "soft", "--l2", "decay")
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {f"{name[:-2]}-{seed}" for name in NAMES for seed in (3, 4)}
    assert said.count("±") == 24
    trained = load_trained(tmp_path / "radar-inverse-4" / "model.pt")
    assert (trained.settings.seed, trained.settings.labels, trained.settings.l2) == (4, "soft", "decay")
    assert len(list(tmp_path.glob("map-sum-*.png"))) == 4  # of the first seed's


def test_a_lidar_of_another_time_than_the_radars_is_refused(drives: Path, tmp_path: Path) -> None:
    shutil.copytree(drives / "test", tmp_path / "old")
    path = tmp_path / "old" / "c" / "truth.npz"
    with np.load(path) as held:
        arrays = dict(held)
    arrays |= {name: arrays[name][::5] for name in ("lidar_stamp_ns", "lidar_cm")}
    np.savez_compressed(path, **arrays)
    with pytest.raises(EchogridError, match=r"c/truth\.npz: turns of the lidar 0\.50 s apart found, expected at most 0\.15 s"):
        run(drives, tmp_path / "out", test=str(tmp_path / "old"))
    material.check_turns([drives / "test" / "c"])


def test_a_town_cannot_be_learned_from_and_tested_on(drives: Path, tmp_path: Path) -> None:
    with pytest.raises(EchogridError, match="--test holds a, which is among --drives as well, expected towns of its own"):
        run(drives, tmp_path, test="learn")


def test_the_arguments_need_no_torch() -> None:
    code = "import sys, echogrid_training.paper.reproduce; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE)
    assert done.stdout.strip() == "False"
