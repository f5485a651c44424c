"""The loop, on rectangles instead of towns: it learns, and goes on after a kill as if there had been none."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.support.rectangles import rectangles
from tests.support.waiting import PATIENCE

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration
from echogrid.errors import EchogridError
from echogrid.model.network import OnnxSensorModel
from echogrid_training.learning import fit, judging, train
from echogrid_training.learning.dataset import Samples, joined
from echogrid_training.learning.loss import Weighting
from echogrid_training.learning.recipe import Network
from echogrid_training.learning.train import Settings, Trained, follow, load_trained, rate_at

TINY = Settings("paper", epochs=4, seed=6, width=4, batch=4, per_epoch=32, rate=1e-2)


@pytest.fixture(scope="module")
def data() -> tuple[Samples, Samples]:
    return rectangles(40, 1), rectangles(8, 2)


@pytest.fixture(scope="module")
def whole(data: tuple[Samples, Samples], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole")
    train.fit(*data, TINY, out)
    return out


def log(out: Path) -> list[dict[str, Any]]:
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert all(0 < line["seconds"] < 600 for line in lines)
    return [{key: value for key, value in line.items() if key != "seconds"} for line in lines]


def test_loss_and_error_fall(whole: Path) -> None:
    lines = log(whole)
    assert [line["epoch"] for line in lines] == [1, 2, 3, 4]
    assert lines[-1]["step"] == 32
    losses = [line["loss"] for line in lines]
    assert losses == sorted(losses, reverse=True)
    assert losses[-1] < 0.8 * losses[0]
    free = [line["held_out_mse"]["free"] for line in lines]
    assert free[-1] < min(free[0], 0.9)


def test_the_default_network_learns_too(data: tuple[Samples, Samples], unet: tuple[Trained, Path]) -> None:
    """After two short epochs it tells the occupied from the free where it has never been; its shares are those of the labels."""
    trained, out = unet
    assert sum(trained.shares) == pytest.approx(1.0)
    assert trained.shares[2] == pytest.approx(np.mean(data[0].labels > 0))
    way = trained.recipe()
    output, labels = next(judging.inferred(way, trained.model(), data[1]))
    log_odds = way.log_odds(output).numpy()
    assert log_odds[labels > 0].mean() > log_odds[labels < 0].mean() + 2.0
    losses = [line["loss"] for line in log(out)]
    assert losses[1] < 0.5 * losses[0]
    assert torch.equal(load_trained(out / "model.pt").weights["core.head.weight"], trained.weights["core.head.weight"])


def test_what_is_kept_to_check_by_are_held_out_images(data: tuple[Samples, Samples], whole: Path) -> None:
    golden = load_trained(whole / "model.pt").golden.numpy()
    assert golden.shape == (3, 12, 128, 128)
    held_out = {image.tobytes() for image in data[1].images}
    assert len({image.tobytes() for image in golden} & held_out) == 3


def test_errors_are_pooled_over_samples_whatever_the_batches(data: tuple[Samples, Samples], whole: Path) -> None:
    """By numpy, all pixels at once, from the network's own answers."""
    trained = load_trained(whole / "model.pt")
    way, model = trained.recipe(), trained.model()
    answers = np.concatenate([way.label(output).numpy() for output, _ in judging.inferred(way, model, data[1], size=3)])
    figures = train.judge(way, model, data[1])
    for kind, label in (("ternary", np.sign(data[1].labels)), ("soft", data[1].labels / 127)):
        for name, value in (("free", -1), ("unknown", 0), ("occupied", 1)):
            member = np.sign(label) == value
            assert figures[kind][name] == pytest.approx(((answers - label)[member] ** 2).mean(), rel=1e-4)


def test_an_interrupted_run_ends_with_the_same_bits(data: tuple[Samples, Samples], whole: Path, tmp_path: Path) -> None:
    def killed(things: Iterable[Any], what: str) -> Iterable[Any]:
        for index, thing in enumerate(things):
            if what == "epoch 3 of 4" and index == 2:
                raise KeyboardInterrupt
            yield thing

    with pytest.raises(KeyboardInterrupt):
        train.fit(*data, TINY, tmp_path, track=killed)
    assert len(log(tmp_path)) == 2
    (tmp_path / "log.jsonl").write_text((tmp_path / "log.jsonl").read_text() + '{"epoch": 3}\n')  # a kill just before the checkpoint
    again = train.fit(*data, TINY, tmp_path, resume=True)
    expected = load_trained(whole / "model.pt")
    assert log(tmp_path) == log(whole)
    assert again.weights.keys() == expected.weights.keys()
    assert all(torch.equal(value, expected.weights[name]) for name, value in again.weights.items())
    for key in ("settings", "calibration", "shares", "data_sha256"):
        assert getattr(again, key) == getattr(expected, key)
    assert torch.equal(again.golden, expected.golden)
    one, other = (torch.load(out / "checkpoint.pt", weights_only=True)["run"]["model"] for out in (tmp_path, whole))
    assert all(torch.equal(value, other[name]) for name, value in one.items())


def test_a_finished_run_that_is_resumed_stays_as_it_is(data: tuple[Samples, Samples], whole: Path) -> None:
    before = log(whole)
    train.fit(*data, TINY, whole, resume=True)
    assert log(whole) == before


def test_another_run_is_not_gone_on_with(data: tuple[Samples, Samples], whole: Path) -> None:
    with pytest.raises(EchogridError, match="holds a run; continue it with --resume"):
        train.fit(*data, TINY, whole)
    with pytest.raises(EchogridError, match=r"checkpoint.pt: is of a run with seed 6, expected 7"):
        train.fit(*data, replace(TINY, seed=7), whole, resume=True)
    with pytest.raises(EchogridError, match=r"checkpoint.pt: is of a run with data_sha256"):
        train.fit(rectangles(40, 3), data[1], TINY, whole, resume=True)


def test_seeds_and_weightings_make_a_difference(data: tuple[Samples, Samples], tmp_path: Path) -> None:
    short = replace(TINY, epochs=1)
    runs = {
        name: train.fit(*data, settings, tmp_path / name).weights["head.weight"]
        for name, settings in (
            ("one", short),
            ("same", short),
            ("seed", replace(short, seed=7)),
            ("inverse", replace(short, weighting="inverse")),
            ("soft", replace(short, labels="soft")),
        )
    }
    assert torch.equal(runs["one"], runs["same"])
    for name in ("seed", "inverse", "soft"):
        assert not torch.equal(runs["one"], runs[name])


def test_the_rate_goes_up_straight_and_down_to_nothing() -> None:
    rates = [rate_at(step, 100, TINY) for step in range(100)]
    assert rates.index(max(rates)) == 9
    assert max(rates) == pytest.approx(TINY.rate)
    assert rates[0] == pytest.approx(TINY.rate / 10)
    assert 0 < rates[-1] < 0.002 * TINY.rate
    assert rate_at(0, 1, TINY) > 0


def test_the_average_follows_weights_and_statistics() -> None:
    slow, fast = torch.nn.BatchNorm2d(3), torch.nn.BatchNorm2d(3)
    fast.weight.data += 1.0
    fast(torch.randn(4, 3, 5, 5, generator=torch.Generator().manual_seed(1)) + 2)
    follow(slow, fast, 0.75)
    assert slow.running_mean is not None
    assert fast.running_mean is not None
    torch.testing.assert_close(slow.weight.data, torch.full((3,), 1.25))
    torch.testing.assert_close(slow.running_mean, 0.25 * fast.running_mean)
    assert slow.num_batches_tracked == 1


def test_what_is_no_model_is_said(tmp_path: Path) -> None:
    (tmp_path / "torn.pt").write_bytes(b"PK\x03\x04 torn")
    with pytest.raises(EchogridError, match="is not a file of PyTorch"):
        load_trained(tmp_path / "torn.pt")
    torch.save({"weights": {}}, tmp_path / "other.pt")
    with pytest.raises(EchogridError, match="is not a model that echogrid-train fit wrote"):
        load_trained(tmp_path / "other.pt")
    with pytest.raises(EchogridError, match="cannot be read"):
        load_trained(tmp_path / "nothing.pt")


@pytest.mark.parametrize("network", ["paper", "default"])
def test_the_command_splits_trains_judges_and_exports(network: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Learned from as disturbed, tested as it is; the default network's map is calibrated with its own file on held-out drives."""
    loaded: list[tuple[int, bool]] = []
    mapped: list[tuple[int, str]] = []

    def load(drives: Sequence[Path], _: object, *, disturbed: bool = False, workers: int = 1) -> Samples:
        loaded.append((len(drives), disturbed))
        return joined([rectangles(2, int(drive.name[-5:])) for drive in drives])

    def calibrated(drives: Sequence[Path], model: Path, _: object) -> Calibration:
        mapped.append((len(drives), model.name))
        assert model.is_file()
        return Calibration(1.5, -1.0)

    def small(network: Network, weighting: Weighting, seed: int) -> Settings:
        return replace(TINY, network=network, weighting=weighting, seed=seed, per_epoch=8)

    for index in range(4):
        (tmp_path / "drives" / f"train-{index:05d}").mkdir(parents=True)
        (tmp_path / "drives" / f"train-{index:05d}" / "truth.npz").touch()
    monkeypatch.setattr(fit, "load_drives", load)
    monkeypatch.setattr(fit, "calibrate_map", calibrated)
    monkeypatch.setattr(train, "small", small)
    parser = argparse.ArgumentParser()
    fit.add_arguments(parser)
    drives, out = str(tmp_path / "drives"), tmp_path / "out"
    arguments = ["--drives", drives, "--test", drives, "--out", str(out), "--network", network, "--epochs", "1", "--small"]
    arguments += ["--weighting", "inverse", "--labels", "soft", "--l2", "loss"]
    said = fit.run(parser.parse_args(arguments))
    assert "learned from 6 samples of 3 drives" in said
    assert "| validation: 1 | 2 |" in said
    assert "| test: 4 | 8 |" in said
    assert loaded == [(3, True), (1, True), (4, False)]
    files = {f"{network}.onnx"} if network == "paper" else {"default.onnx", "default.int8.onnx"}
    written = {path.name for path in out.iterdir() if path.is_file() and not path.name.startswith("events.")}
    assert written == {"log.jsonl", "checkpoint.pt", "model.pt"} | files
    assert all(str(out / name) in said for name in files)
    assert mapped == ([] if network == "paper" else [(1, "default.onnx")])
    trained = load_trained(out / "model.pt")
    assert (trained.settings.weighting, trained.settings.labels, trained.settings.l2) == ("inverse", "soft", "loss")
    assert (trained.settings.epochs, trained.settings.network) == (1, network)
    by_itself = Calibration(*trained.calibration)
    for name in files:
        contract = OnnxSensorModel(out / name, GridSpec(), {}).contract
        assert contract.calibration == (by_itself if network == "paper" else Calibration(1.5, -1.0))
    with pytest.raises(SystemExit):
        parser.parse_args([*arguments, "--epochs", "0"])


def test_the_arguments_need_no_torch() -> None:
    code = "import sys, echogrid_training.learning.fit; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE)
    assert done.stdout.strip() == "False"


def test_drives_are_taken_from_the_first_to_the_last() -> None:
    drives = [Path(f"{number}") for number in range(9)]
    assert fit.some(drives, 3) == [drives[0], drives[4], drives[8]]
    assert fit.some(drives, 20) == drives


@pytest.mark.parametrize(("text", "share"), [("0", 0.0), ("0.25", 0.25), ("1", 1.0)])
def test_all_of_a_file_s_weights_may_stay_or_go(text: str, share: float) -> None:
    parser = argparse.ArgumentParser()
    fit.add_arguments(parser)
    assert parser.parse_args(["--out", "out", "--drives", "drives", "--keep", text]).keep == share
