"""The command, on copies of one tiny drive; and what its figures are made of."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from echogrid.errors import EchogridError
from echogrid_training.evaluation.metrics import average_precision
from echogrid_training.learning.autoencoder import PaperAutoencoder
from echogrid_training.learning.dataset import load_drive
from echogrid_training.learning.train import load_trained
from echogrid_training.learning.unet import UNet
from echogrid_training.paper import ablate
from echogrid_training.paper.variants import BINS, FIGURES, PAIRS, TITLES, VARIANTS, WIDEST, Tried, drawn, figures, markdown

pytestmark = pytest.mark.usefixtures("tiny")


def run(drives: Path, out: Path, *more: str) -> str:
    parser = argparse.ArgumentParser()
    ablate.add_arguments(parser)
    given = ["--drives", drives / "learn", "--test", drives / "test", "--out", out, "--small", "--seed", "3", "--workers", "1", *more]
    return ablate.run(parser.parse_args(list(map(str, given))))


@pytest.fixture(scope="module")
def made(drives: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder, and what the command says."""
    out = tmp_path_factory.mktemp("out")
    return out, run(drives, out)


CHANGED = ({"labels"}, {"l2"}, {"network"}, {"planes"}, {"planes"}, {"body"}, {"body"})


def test_neighbours_differ_in_what_the_table_says_and_in_nothing_else(made: tuple[Path, str], drives: Path) -> None:
    """By the settings in the files, and the networks and images that they make."""
    of = {name: load_trained(made[0] / f"{name}-3" / "model.pt") for name in VARIANTS}
    test = load_drive(drives / "test" / "c", whole=True)
    for name, trained in of.items():
        network, image, loss = TITLES[name]
        assert isinstance(trained.model(), PaperAutoencoder if network == "autoencoder" else UNet)
        assert trained.recipe().shown(test)[0].shape[1] == (12 if image == "15 m of history" else 1)
        assert (trained.settings.network == "default") == loss.startswith("cross-entropy")
        assert (trained.settings.l2 == "decay") == loss.endswith("decay")
        assert (trained.settings.labels == "soft") == loss.endswith("soft labels")
    for (_, before, after), keys in zip(PAIRS, CHANGED, strict=False):
        # A network of the paper's has no use for the default's settings, nor the other way round.
        one, other = (asdict(of[name].settings) for name in (before, after))
        free = {"body", "planes"} if keys == {"network"} else set()
        assert {key for key in one if one[key] != other[key]} - free == keys
    assert len({(trained.data_sha256, trained.settings.seed, trained.settings.epochs) for trained in of.values()}) == 1
    assert len({json.loads((made[0] / f"{name}-3" / "log.jsonl").read_text())["step"] for name in VARIANTS}) == 1


def test_the_table_judges_the_test_drive(made: tuple[Path, str], drives: Path) -> None:
    """The same figures of the drive's labels and the networks' answers, cell by cell."""
    test = load_drive(drives / "test" / "c", whole=True)
    truth = np.sign(test.labels.astype(int))
    held = json.loads((made[0] / "ablation.json").read_text("utf-8"))
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in made[1].splitlines() if line.startswith("|")]
    for (name, of), row in zip(held["variants"].items(), rows[2:9], strict=True):
        trained = load_trained(made[0] / f"{name}-3" / "model.pt")
        recipe = trained.recipe()
        output = trained.model()(recipe.shown(test)[0])
        answer = recipe.label(output).numpy()
        for sign, figure in zip((-1, 0, 1), ("free", "unknown", "occupied"), strict=True):
            assert of[figure]["mean"] == pytest.approx(((answer - truth)[truth == sign] ** 2).mean(), rel=1e-4)
        z = trained.calibration[0] * recipe.log_odds(output).numpy()[truth != 0].astype(float) + trained.calibration[1]
        p = 1 / (1 + np.exp(-z))
        assert of["nll"]["mean"] == pytest.approx(-np.log(np.where(truth[truth != 0] > 0, p, 1 - p)).mean(), rel=1e-4)
        binned = np.floor((z + WIDEST) * BINS / (2 * WIDEST))
        assert of["ap"]["mean"] == pytest.approx(average_precision(binned, truth[truth != 0] > 0), rel=1e-6)
        assert [cell.split()[0] for cell in row[3:]] == [f"{of[figure]['mean']:.3f}" for figure in FIGURES]
        assert len(of["sha256"]) == 1
    assert held["parts"]["test"]["drives"] == ["c"]


def tried(free: float, occupied: float, weight: float = 1.0) -> Tried:
    """In two towns, the second with twice the cells and `weight` times the errors of the first."""
    town = np.array([[free, 0.1, occupied], [1.0, 1.0, 1.0]]) * 100
    errors = np.stack((town, 2 * town * np.array((weight, 1.0))[:, None]))
    histogram = np.zeros((2, 2, BINS))
    histogram[0, :, (0, -1)] = ((90, 0), (0, 10))  # told apart
    histogram[1, :, 7] = (190, 10)  # not at all
    return Tried(errors, histogram, np.array((20.0, 70.0)), 8, "beef")


def test_figures_pool_the_cells_of_the_towns() -> None:
    of = drawn(tried(0.2, 0.8, 3.0), np.array(((1, 1), (2, 0), (0, 2))))
    assert of["free"] == pytest.approx((0.2 * 7 / 3, 0.2, 0.6))
    assert of["occupied"] == pytest.approx((0.8 * 7 / 3, 0.8, 2.4))
    assert of["nll"] == pytest.approx((90 / 300, 20 / 100, 70 / 200))
    assert of["ap"] == pytest.approx(((10 + 10 * 20 / 210) / 20, 1.0, 10 / 200))


def test_changes_are_after_less_before_seed_by_seed_and_draw_by_draw() -> None:
    """Where both are worse in the same town, their difference hangs less on towns than they do."""
    found = {name: [tried(0.2, 0.8, 3.0), tried(0.4, 0.8, 3.0)] for name in VARIANTS}
    found["paper-soft"] = [tried(0.1, 0.9, 3.0), tried(0.1, 0.9, 3.0)]
    held = figures(found)
    change = held["changes"]["soft labels instead of −1, 0 and 1"]
    assert change["free"]["mean"] == pytest.approx((-0.1 - 0.3) / 2 * 7 / 3)
    assert change["free"]["spread"] == pytest.approx(0.2 * 7 / 3 / np.sqrt(2))
    assert change["free"]["interval"] == pytest.approx((-0.6, -0.2))
    assert change["occupied"]["interval"] == pytest.approx((0.1, 0.3))
    assert held["changes"]["all together"]["occupied"]["mean"] == 0.0
    json.dumps(held, allow_nan=False)
    lines = markdown(held).splitlines()
    assert lines[2].startswith("| autoencoder | newest scans | class MSE, L2 in the loss | 0.700 ± 0.330 [0.300, 0.900] |")
    assert lines[12].startswith("| soft labels instead of −1, 0 and 1 | -0.467 ± 0.330 [-0.600, -0.200] |")


def test_a_class_that_is_nowhere_has_no_figure() -> None:
    one = tried(0.2, 0.8)
    one.errors[:, :, 1] = 0.0
    held = figures({name: [one] for name in VARIANTS})
    assert held["variants"]["paper"]["unknown"] == {"mean": None, "spread": None, "interval": None}
    assert markdown(held).splitlines()[2].split(" | ")[4] == "–"


def test_what_is_done_is_not_done_again(made: tuple[Path, str], drives: Path) -> None:
    with pytest.raises(EchogridError, match="paper-3: holds a run; continue it with --resume"):
        run(drives, made[0])
    assert run(drives, made[0], "--resume") == made[1]
