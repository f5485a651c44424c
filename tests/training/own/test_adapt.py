"""Adaptation: what is learned from is not scored, the fit finds what was hidden, and the file says where it comes from."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.model.choice import shipped
from echogrid.model.network import KEY, OnnxSensorModel
from echogrid_training import cli
from echogrid_training.evaluation.recorded.scores import Rectangle
from echogrid_training.own import half as half_module
from echogrid_training.own import patches as patches_module
from echogrid_training.own.adapt import Tried, chosen
from echogrid_training.own.calibrating import counts, crossed, fitted, least_found, read, score, scores, surely_better
from echogrid_training.own.half import Half
from echogrid_training.own.hindsight import Judged
from echogrid_training.own.patches import FOLDS, GUARD, Patch, keep_own


def made_up(rng: np.random.Generator, cells: int, hidden: Calibration) -> Patch:
    """Cells that are occupied as often as the network says, once it is read out by `hidden`; nothing was measured."""

    def layers(count: int) -> np.ndarray:
        mean = (rng.normal(-1.0, 4.0, count) - hidden.offset) / hidden.learned
        return np.stack((mean * 5, np.full(count, 5.0), *np.zeros((3, count)))).astype(np.float32)

    own, around = layers(cells), layers(cells // 10)
    p = 1 / (1 + np.exp(-(hidden.learned * own[0] / own[1] + hidden.offset)))
    true = rng.uniform(size=cells) < p
    chance = np.where(true, 0.98, 0.01).astype(np.float32)
    occupied = 1 / (1 + np.exp(-(hidden.learned * around[0] / around[1] + hidden.offset))) > 0.5
    return Patch(0, own, chance, np.where(true, 1, -1).astype(np.int8), np.repeat(around[:, occupied, None], 5, axis=2))


def test_a_wrong_last_step_is_put_right() -> None:
    hidden, wrong = Calibration(1.5, 1.0), Calibration(1.0, -2.0)
    rng = np.random.default_rng(3)
    part, other = made_up(rng, 20000, hidden), made_up(rng, 20000, hidden)
    found = fitted(part, wrong)
    assert score(other, found).cost < 0.75 * score(other, wrong).cost
    assert score(other, found).cost < 1.02 * score(other, hidden).cost


@pytest.mark.parametrize("seed", [0, 1])
def test_no_less_is_found_where_finding_less_would_be_cheapest(seed: int) -> None:
    """A street of reflections and free ground, whose network says too much, beside a grid of all numbers."""
    rng, start = np.random.default_rng(seed), Calibration(1.0, 0.5)

    def layers(count: int, said: float, hits: float, passes: float) -> np.ndarray:
        mean, measured = rng.normal(said, 3.0, count), rng.poisson((hits, 2 * hits, passes), (count, 3)).T
        return np.stack((mean * 5, np.full(count, 5.0), *measured)).astype(np.float32)

    free, things = layers(3000, -3.0, 0.05, 12.0), layers(500, -1.0, 1.0, 6.0)
    part = Patch(0, free, np.full(3000, 0.01, np.float32), np.full(3000, -1, np.int8), np.repeat(things[:, :, None], 5, axis=2))
    before = score(part, start)
    tried = [score(part, Calibration(a, b)) for a in np.geomspace(0.4, 4.0, 21) for b in np.linspace(-3.5, 3.5, 29)]
    cheapest = min(tried, key=lambda one: one.cost)
    kept = min((one for one in tried if one.found >= before.found), key=lambda one: one.cost)
    found = score(part, fitted(part, start))
    assert cheapest.found < before.found - 0.1
    assert found.found >= before.found
    assert cheapest.cost < found.cost < 1.02 * kept.cost
    assert found.cost < 0.95 * before.cost


def test_cells_are_read_as_the_map_reads_them() -> None:
    rng = np.random.default_rng(1)
    layers = rng.uniform(0.0, 5.0, (5, 40, 30)).astype(np.float32) * (rng.uniform(size=(5, 40, 30)) < 0.6)
    for calibration in (Calibration(1.0, 0.0), Calibration(0.7, -1.2)):
        np.testing.assert_array_equal(read(layers, calibration), LookMap(GridSpec(), calibration).read(layers))


def test_what_is_fitted_to_is_not_scored() -> None:
    """100 m straight on by stretches of 10 m: no two share a cell, and none has cells near the way of another fold."""
    driven = [EgoState(0, SE2(x, 0.0, 0.0), 5.0, 0.0) for x in np.arange(0.0, 100.0, 0.5)]
    stretches = [int(ego.odom_from_base.x // 10) for ego in driven]
    half = Half(LookMap(GridSpec(), Calibration()), "", driven=driven, stretches=stretches)
    where = Rectangle(-80, -40, 160, 500, 0.25)
    kept = np.zeros((160, 500), np.int64)
    for stretch in range(10):
        judged = Judged(np.ones((160, 500), np.int8), np.full((160, 500), 0.5, np.float32))
        keep_own(judged, where, half, stretch)
        mine = np.isfinite(judged.chance)
        np.testing.assert_array_equal(judged.label != 0, mine)
        assert mine.sum() > 100
        kept += mine
        row, column = np.nonzero(mine)
        for y, x in zip((row[::97] - 79.5) * 0.25, (column[::97] - 39.5) * 0.25, strict=True):
            others = [ego for ego, one in zip(driven, stretches, strict=True) if (one - stretch) % FOLDS]
            assert min(math.hypot(ego.odom_from_base.x - x, y) for ego in others) > GUARD - 1e-6
    assert kept.max() == 1


def test_figures_of_a_stretch_do_not_hang_on_it() -> None:
    """What is fitted to other folds knows nothing of a stretch whose own numbers are quite others."""
    rng = np.random.default_rng(6)
    usual, odd = Calibration(1.0, 0.0), Calibration(2.0, 3.0)
    parts = [replace(made_up(rng, 6000, odd if fold == 1 else usual), fold=fold) for fold in (0, 1, 2, 0)]
    crossed_counts = crossed(parts, Calibration(1.0, -1.0))
    for index in (0, 2, 3):
        others = Patch.joined([one for one in parts if one.fold != parts[index].fold])
        np.testing.assert_array_equal(crossed_counts[index], counts(parts[index], fitted(others, Calibration(1.0, -1.0))))
    own = score(parts[1], fitted(parts[1], Calibration(1.0, -1.0)))
    assert scores(crossed_counts[1]).cost > 1.05 * own.cost


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stretches that a drive of 15 m has enough of."""
    monkeypatch.setattr(half_module, "STRETCH", 4.0)
    monkeypatch.setattr(patches_module, "GUARD", 0.5)


@pytest.mark.usefixtures("short")
def test_the_file_says_where_it_comes_from(street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.onnx"
    assert cli.main(["adapt", "default", str(street), "--calibrate-only", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "| on stretches that were not fitted to | before | last step |" in said
    parent, mine = OnnxSensorModel(shipped("default")[0], GridSpec(), {}), OnnxSensorModel(out, GridSpec(), {})
    held = json.loads(next(one.value for one in onnx.load(out).metadata_props if one.key == KEY))
    assert held["parent"] == {"file": parent.path.name, "sha256": hashlib.sha256(parent.path.read_bytes()).hexdigest()}
    parts = b"".join(hashlib.sha256((street / name).read_bytes()).digest() for name in ("echogrid.toml", "can.log.gz"))
    assert held["drives"] == [{"name": "street", "sha256": hashlib.sha256(parts).hexdigest()}]
    assert held["before"]["detections"] == held["after"]["detections"] > 0
    assert held["after"]["found"] is not None
    image = np.random.default_rng(1).integers(0, 9, (12, 128, 128)).astype(np.uint8)
    np.testing.assert_array_equal(mine.run(image), parent.run(image))  # the network is the same
    assert cli.main(["evaluate", "own", str(street), "--model", str(out)]) == 0


def test_mistakes_are_one_sentence(street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "mine.onnx")
    for arguments, expected in (
        (["default", str(street), "--out", out], "street: too short to fit to one part and score on another"),
        (["paper", str(street), "--out", out], "paper.onnx: is meant for fusion = 'sum', expected 'looks'"),
        (["default", str(street), "--out", str(tmp_path / "mine")], "mine: expected a name that ends in .onnx"),
        (["default", str(tmp_path / "none"), "--out", out], "none: there is no such file or folder"),
    ):
        assert cli.main(["adapt", *arguments, "--calibrate-only"]) == 1
        printed = capsys.readouterr()
        assert expected in printed.err
        assert printed.err.count("\n") == 1
    assert not Path(out).exists()


def test_what_is_better_by_luck_is_not_surely_better() -> None:
    """One stretch of eight that gains much, and eight that gain a little each."""
    part = made_up(np.random.default_rng(4), 4000, Calibration(1.0, 0.0))
    before = np.tile(counts(part, Calibration(1.0, 0.0)), (8, 1))
    lucky, steady = before.copy(), before.copy()
    lucky[0, 1] -= 0.5 * lucky[0, 0]
    lucky[1:, 1] += 0.01 * lucky[1:, 0]
    steady[:, 1] += 0.01 * steady[:, 0]
    assert scores(before.sum(axis=0)) == score(Patch.joined([part] * 8), Calibration(1.0, 0.0))
    assert surely_better(before, steady) == 1.0
    assert surely_better(before, lucky) < 0.5
    assert surely_better(before, before) == 0.0


def test_a_small_gain_by_the_last_step_alone_is_not_written() -> None:
    """However sure it is: on other streets it may be a loss. The costs are 1.75 before, 1.65 and 1.5."""

    def tried(found: int, worth: float = 0.1) -> Tried:
        counts = np.tile((100, found, 5, 1000, 500, 10, 1000, 300), (8, 1)).astype(float)
        return Tried(f"{found} of 100 found", [], Calibration(), counts, worth)

    first, small, large, learned = tried(50), tried(60), tried(75), tried(60, worth=0.0)
    np.testing.assert_allclose([one.scores.cost for one in (first, small, large)], (1.75, 1.65, 1.5))
    assert small.better(first) == large.better(first) == 1.0
    assert chosen([first, small]) is first
    assert chosen([first, small, learned]) is learned
    assert chosen([first, large, learned]) is large
    assert chosen([large, small, learned]) is large


def test_what_finds_less_than_streets_alone_would_make_it_is_not_written() -> None:
    """However cheap and however sure. Of 100 reflections a stretch, 40 and 60 are found by turns."""

    def tried(less: int) -> Tried:
        found = np.array((40, 60) * 4) - less
        rest = (20, 1000, 500, 10, 1000, 300) if less == 0 else (0, 1000, 900, 0, 1000, 300)
        return Tried(f"{less} of 100 less", [], Calibration(), np.array([(100, one, *rest) for one in found], dtype=float))

    first, few, many = tried(0), tried(2), tried(10)
    assert least_found(first.counts) == pytest.approx(0.5 - 1.96 * 0.1 / 8**0.5, abs=0.01)
    assert few.better(first) == many.better(first) == 1.0
    assert chosen([first, few]) is few
    assert chosen([first, many]) is first
