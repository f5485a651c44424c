"""The training loop, straight down. Its command is fit.py's:

    echogrid-train fit --drives drives --out models/paper --weighting independent --epochs 30 --seed 1
    echogrid-train fit --drives drives --out models/paper --weighting independent --epochs 30 --seed 1 --resume

The folder `--out` holds log.jsonl, a line an epoch; checkpoint.pt, from which a killed run continues; and model.pt, which export.py reads.
"""

from __future__ import annotations

import copy
import json
import math
import pickle
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.tensorboard import SummaryWriter

from echogrid.errors import EchogridError
from echogrid_training.learning.autoencoder import decayed, squared
from echogrid_training.learning.best import Best
from echogrid_training.learning.dataset import Samples, ternary
from echogrid_training.learning.judging import held_out_loss, inferred, judge
from echogrid_training.learning.loss import Weighting, calibrate
from echogrid_training.learning.ranks import Ranks, joined_ranks
from echogrid_training.learning.recipe import Body, Default, Kind, Network, Paper, Recipe, Sensor, shares
from echogrid_training.learning.unet import PLANES
from echogrid_training.recording import Track, untracked

CHECKPOINT, LOG, MODEL = "checkpoint.pt", "log.jsonl", "model.pt"
GOLDEN = 3  # held-out images that the exported model carries
BOARD_STEPS = 20  # between two losses on TensorBoard
LOOK = 512  # held-out samples that each epoch is judged by

L2 = Literal["decay", "loss"]  # AdamW's decay of the convolutions' weights, or the paper's: squares of all weights as a part of the loss


@dataclass(frozen=True, slots=True)
class Settings:
    """All that a run hangs on besides its samples. The defaults are for a GPU or a night; small() is for minutes on two cores."""

    network: Network = "default"
    weighting: Weighting = "independent"  # of classes, in the paper's loss
    epochs: int = 30
    seed: int = 0
    width: int = 32  # of the autoencoder
    batch: int = 64
    per_epoch: int | None = None  # samples drawn for each epoch; None for all
    sensor: Sensor = "radar"  # whose image the paper's network is shown
    labels: Kind = "ternary"  # that the paper's loss compares with
    rate: float = 2e-3  # at the peak of the cycle
    warm: float = 0.1  # share of all steps until that peak
    l2: L2 = "decay"
    decay: float = 1e-4  # the strength of either
    clip: float = 1.0  # of the gradient's norm
    average: float = 0.999  # how much of the weights' moving average each step keeps, once it is old enough
    body: Body = "unet"  # of the default recipe
    planes: int = PLANES  # of the image that the default recipe shows


def small(network: Network, weighting: Weighting, seed: int) -> Settings:
    """A network in five minutes on two cores: enough to rank variants, not to show how good they get."""
    return Settings(network, weighting, 4, seed, width=16, batch=32, per_epoch=4096)


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """What a run ends with, and what export.py makes a file of."""

    settings: Settings
    weights: dict[str, Tensor]  # the moving average
    data_sha256: str
    calibration: tuple[float, float]  # a, b: a * logits + b are log-odds where something was observed
    golden: Tensor  # (3, 12, 128, 128) bytes: some held-out images
    shares: tuple[float, float, float]  # of free, unknown and occupied in what was learned from

    def recipe(self) -> Recipe:
        return recipe(self.settings, self.shares)

    def model(self) -> nn.Module:
        """With the learned weights, ready to infer."""
        model = self.recipe().network()
        model.load_state_dict(self.weights)
        return model.eval().requires_grad_(False)


def recipe(settings: Settings, of_classes: tuple[float, float, float]) -> Recipe:
    if settings.network == "paper":
        return Paper(settings.width, settings.weighting, settings.labels, settings.sensor)
    return Default(of_classes, settings.body, settings.planes, settings.width)


class Run:
    """What lives from step to step: the weights, their moving average, the optimiser, and how many epochs are done."""

    def __init__(self, settings: Settings, recipe: Recipe, device: torch.device, start: dict[str, Tensor] | None = None) -> None:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            model = recipe.network()
        if start is not None:
            model.load_state_dict(start)
        self.model = model.to(device)
        for weight in self.model.parameters():
            if weight.dim() == 4:  # half as fast again on a CPU
                weight.data = weight.data.contiguous(memory_format=torch.channels_last)
        self.average = copy.deepcopy(self.model).requires_grad_(False).eval()
        weights, others = decayed(self.model)
        decay = settings.decay if settings.l2 == "decay" else 0.0
        groups = [{"params": weights, "weight_decay": decay}, {"params": others, "weight_decay": 0.0}]
        self.optimiser = torch.optim.AdamW(groups, lr=settings.rate)
        self.epoch = 0

    def state(self) -> dict[str, Any]:
        return {
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "epoch": self.epoch,
        }

    def restore(self, state: dict[str, Any]) -> None:
        self.model.load_state_dict(state["model"])
        self.average.load_state_dict(state["average"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.epoch = state["epoch"]


def fit(
    learned: Samples,
    held_out: Samples,
    settings: Settings,
    out: Path,
    *,
    resume: bool = False,
    track: Track = untracked,
    data_sha256: str | None = None,
    start: dict[str, Tensor] | None = None,
    patience: int | None = None,
) -> Trained:
    """Trains, and writes log, checkpoints and model into `out`. An interrupted run that is resumed ends with the same bits on a CPU.

    `start`: weights to begin with instead of random ones (warm_start.py). `patience`: the weights of the epoch with the least loss on
    `held_out` are kept, those of the start among them, and so many epochs without a lesser one are the last; not to be resumed.

    Raises EchogridError where `out` holds another run, or this one without `resume`.
    """
    data_sha256 = data_sha256 or learned.digest()
    with joined_ranks() as ranks:
        return _fit(learned, held_out, settings, out, data_sha256, resume, track, ranks, start, patience)


def _fit(
    learned: Samples,
    held_out: Samples,
    settings: Settings,
    out: Path,
    data_sha256: str,
    resume: bool,
    track: Track,
    ranks: Ranks,
    start: dict[str, Tensor] | None,
    patience: int | None,
) -> Trained:
    of_classes = shares(learned.labels)
    way = recipe(settings, of_classes)
    run = Run(settings, way, ranks.device, start)
    out.mkdir(parents=True, exist_ok=True)
    what = asdict(settings) | {"data_sha256": data_sha256}
    _take_up(run, what, out, resume, ranks)
    parallel = ranks.wrapped(run.model)
    board = SummaryWriter(str(out)) if ranks.writes else None
    count = min(len(learned), settings.per_epoch or len(learned))
    size = min(settings.batch, count)
    per_epoch = count // size
    steps = settings.epochs * per_epoch
    best = Best(patience) if patience is not None else None
    if best is not None:
        best.stale(run.average, held_out_loss(way, run.average, thinned(held_out, LOOK)))
    for epoch in range(run.epoch, settings.epochs):
        began, total = time.monotonic(), 0.0
        rng = np.random.default_rng((settings.seed, epoch, ranks.rank))  # an epoch is the same whatever came before it
        order = np.random.default_rng((settings.seed, epoch)).permutation(len(learned))
        batches = order[: per_epoch * size].reshape(per_epoch, size)
        run.model.train()
        for index, chosen in enumerate(track(batches, f"epoch {epoch + 1} of {settings.epochs}")):
            image, label = (tensor.to(ranks.device) for tensor in way.shown(learned.chosen(ranks.share(chosen)), rng))
            with torch.autocast(ranks.device.type, torch.bfloat16, enabled=ranks.device.type == "cuda"):
                output = parallel(image)
            loss = way.loss(output.float(), label)
            if settings.l2 == "loss":
                loss = loss + settings.decay * squared(run.model)
            run.optimiser.zero_grad()
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(run.model.parameters(), settings.clip, error_if_nonfinite=True)
            step = epoch * per_epoch + index
            for group in run.optimiser.param_groups:
                group["lr"] = rate_at(step, steps, settings)
            run.optimiser.step()
            follow(run.average, run.model, min(settings.average, (1 + step) / (10 + step)))
            total += loss.item()
            if board is not None and step % BOARD_STEPS == 0:
                board.add_scalar("loss", loss.item(), step)
        run.epoch = epoch + 1
        if board is not None:
            mse = judge(way, run.average, thinned(held_out, LOOK))["ternary"]
            line = {"epoch": run.epoch, "step": run.epoch * per_epoch, "loss": total / per_epoch, "seconds": time.monotonic() - began}
            _note(out / LOG, line | {"held_out_mse": mse})
            for name, error in mse.items():
                board.add_scalar(f"held-out class MSE/{name}", error, run.epoch * per_epoch)
            _save(out / CHECKPOINT, {"what": what, "run": run.state()})
        if best is not None and best.stale(run.average, held_out_loss(way, run.average, thinned(held_out, LOOK))):
            break
    if best is not None:
        run.average.load_state_dict(best.weights)
    if board is not None:
        board.close()
    return _finish(run, way, of_classes, settings, data_sha256, held_out if len(held_out) else learned, out if ranks.writes else None)


def rate_at(step: int, steps: int, settings: Settings) -> float:
    """One cycle: straight up to the peak, then half a cosine down to 0."""
    warm = max(settings.warm * steps, 1.0)
    if step + 1 < warm:
        return settings.rate * (step + 1) / warm
    return settings.rate * 0.5 * (1 + math.cos(math.pi * (step + 1 - warm) / (steps + 1 - warm)))


@torch.no_grad()
def follow(average: nn.Module, model: nn.Module, keep: float) -> None:
    """Moves `average`, batch norms' statistics included, towards `model` in place."""
    for slow, fast in zip(average.state_dict().values(), model.state_dict().values(), strict=True):
        if slow.is_floating_point():
            slow.lerp_(fast, 1 - keep)
        else:
            slow.copy_(fast)  # how many batches were seen


def thinned(samples: Samples, count: int) -> Samples:
    """At most `count` of them, evenly spread."""
    return samples.chosen(np.unique(np.linspace(0, max(len(samples) - 1, 0), min(count, len(samples))).astype(np.intp)))


def _finish(
    run: Run, way: Recipe, of_classes: tuple[float, float, float], settings: Settings, data_sha256: str, held_out: Samples, out: Path | None
) -> Trained:
    some = thinned(held_out, LOOK)
    answers = ((way.log_odds(output), torch.from_numpy(ternary(labels))) for output, labels in inferred(way, run.average, some))
    golden = torch.from_numpy(some.images[np.linspace(0, len(some) - 1, GOLDEN + 2)[1:-1].astype(np.intp)])
    weights = {name: value.cpu().contiguous() for name, value in run.average.state_dict().items()}
    trained = Trained(settings, weights, data_sha256, calibrate(answers), golden, of_classes)
    if out is not None:
        _save(out / MODEL, {name: getattr(trained, name) for name in Trained.__dataclass_fields__} | {"settings": asdict(settings)})
    return trained


def load_trained(path: Path) -> Trained:
    """Raises EchogridError for what is not a trained model."""
    held = _load(path)
    try:
        return Trained(**held | {"settings": Settings(**held["settings"])})
    except (TypeError, KeyError) as error:
        raise EchogridError(f"{path}: is not a model that echogrid-train fit wrote: {error}") from error


def check_new(out: Path, *, resume: bool) -> None:
    """Raises EchogridError where `out` holds a run that is not to be continued."""
    if (out / CHECKPOINT).exists() and not resume:
        raise EchogridError(f"{out}: holds a run; continue it with --resume, or give another folder")


def _take_up(run: Run, what: dict[str, Any], out: Path, resume: bool, ranks: Ranks) -> None:
    """Continues from the checkpoint in `out`, if there is one."""
    check_new(out, resume=resume)
    path = out / CHECKPOINT
    if path.exists():
        held = _load(path)
        for key, value in what.items():
            if held["what"].get(key) != value:
                raise EchogridError(f"{path}: is of a run with {key} {held['what'].get(key)}, expected {value}: give another folder")
        run.restore(held["run"])
    if not ranks.writes:
        return
    lines = (out / LOG).read_text("utf-8").splitlines() if run.epoch else []
    (out / LOG).write_text("".join(f"{line}\n" for line in lines[: run.epoch]), "utf-8")  # a kill may have come before the checkpoint


def _note(path: Path, line: dict[str, Any]) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line) + "\n")


def _save(path: Path, what: dict[str, Any]) -> None:
    """Whole or not at all."""
    partial = path.with_name(f".{path.name}.partial")
    torch.save(what, partial)
    partial.replace(path)


def _load(path: Path) -> dict[str, Any]:
    try:
        held: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error
    except (RuntimeError, ValueError, EOFError, KeyError, pickle.UnpicklingError) as error:
        raise EchogridError(f"{path}: is not a file of PyTorch: {error}") from error
    return held
