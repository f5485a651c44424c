"""What the paper's network and the default differ in, one thing at a time: variants that learn the same samples in as many steps."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid_training.evaluation.metrics import precision_area, surprise
from echogrid_training.learning.dataset import Samples, ternary
from echogrid_training.learning.judging import errors, inferred
from echogrid_training.learning.loss import CLASSES
from echogrid_training.learning.train import LOG, MODEL, Settings, Trained, fit
from echogrid_training.recording import Track
from echogrid_training.resampling import interval, resamples

BINS, WIDEST = 2048, 16.0  # of log-odds, from -WIDEST to WIDEST
PLAIN: dict[str, Any] = {"network": "paper", "weighting": "independent", "sensor": "radar", "labels": "ternary", "l2": "loss"}
CLASSED: dict[str, Any] = {"network": "default", "l2": "decay"}
VARIANTS: Mapping[str, dict[str, Any]] = {
    "paper": PLAIN,
    "paper-soft": PLAIN | {"labels": "soft"},
    "paper-decay": PLAIN | {"l2": "decay"},
    "autoencoder-newest": CLASSED | {"body": "autoencoder", "planes": 1},
    "autoencoder-history": CLASSED | {"body": "autoencoder"},
    "unet-newest": CLASSED | {"planes": 1},
    "unet-history": CLASSED,
}
TITLES = {
    "paper": ("autoencoder", "newest scans", "class MSE, L2 in the loss"),
    "paper-soft": ("autoencoder", "newest scans", "the same, soft labels"),
    "paper-decay": ("autoencoder", "newest scans", "class MSE, decay"),
    "autoencoder-newest": ("autoencoder", "newest scans", "cross-entropy, decay"),
    "autoencoder-history": ("autoencoder", "15 m of history", "cross-entropy, decay"),
    "unet-newest": ("U-Net", "newest scans", "cross-entropy, decay"),
    "unet-history": ("U-Net", "15 m of history", "cross-entropy, decay"),
}
PAIRS = (  # what is changed, in which variant, into which
    ("soft labels instead of −1, 0 and 1", "paper", "paper-soft"),
    ("decay instead of L2 in the loss", "paper", "paper-decay"),
    ("cross-entropy instead of class MSE", "paper-decay", "autoencoder-newest"),
    ("history, autoencoder", "autoencoder-newest", "autoencoder-history"),
    ("history, U-Net", "unet-newest", "unet-history"),
    ("U-Net, newest scans", "autoencoder-newest", "unet-newest"),
    ("U-Net, history", "autoencoder-history", "unet-history"),
    ("all together", "paper", "unet-history"),
)
FIGURES = {**{name: f"MSE {name}" for name in CLASSES}, "ap": "AP", "nll": "NLL"}


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """A variant from one seed, judged town by town. Its log-odds are calibrated on the held-out drives by train.Trained's two numbers."""

    errors: Floats  # (T, 2, 3): loss.class_sums against labels -1, 0 and 1
    histogram: Floats  # (T, 2, BINS): observed cells, free and occupied, by log-odds
    surprise: Floats  # (T,) nats, over the observed cells
    steps: int
    sha256: str  # of its file


def try_all(
    learned: Samples, held_out: Samples, towns: Sequence[Samples], settings: Sequence[Settings], out: Path, *, resume: bool, track: Track
) -> dict[str, list[Tried]]:
    """By variant, from each seed, each in a folder of `out` named for both. Raises EchogridError as train.fit does.

    `settings`: one for each seed; what makes a variant is put in here.
    """
    found: dict[str, list[Tried]] = {name: [] for name in VARIANTS}
    digest = learned.digest()
    for seed in settings:
        for name, variant in VARIANTS.items():
            folder = out / f"{name}-{seed.seed}"
            trained = fit(learned, held_out, replace(seed, **variant), folder, resume=resume, track=track, data_sha256=digest)
            steps = json.loads((folder / LOG).read_text("utf-8").splitlines()[-1])["step"]
            found[name].append(judged(trained, towns, steps, hashlib.sha256((folder / MODEL).read_bytes()).hexdigest()))
    return found


def judged(trained: Trained, towns: Sequence[Samples], steps: int, sha256: str) -> Tried:
    """On the samples of each town."""
    recipe, model, (a, b) = trained.recipe(), trained.model(), trained.calibration
    sums = np.stack([errors(recipe, model, town)["ternary"].numpy() for town in towns])
    histogram, lost = np.zeros((len(towns), 2, BINS)), np.zeros(len(towns))
    for number, town in enumerate(towns):
        for output, labels in inferred(recipe, model, town):
            truth = ternary(labels)
            z = a * recipe.log_odds(output).numpy()[truth != 0].astype(float) + b
            occupied = truth[truth != 0] > 0
            bins = np.clip((z + WIDEST) * (BINS / (2 * WIDEST)), 0, BINS - 1).astype(np.intp)
            histogram[number] += np.bincount(bins + BINS * occupied, minlength=2 * BINS).reshape(2, BINS)
            lost[number] += surprise(z, occupied).sum()
    return Tried(sums, histogram, lost, steps, sha256)


def drawn(tried: Tried, draws: NDArray[np.int64]) -> dict[str, Floats]:
    """(D,) of each of FIGURES, with towns pooled as often as `draws` (D, T) says."""
    often = draws.astype(float)
    squared, cells = np.moveaxis(np.tensordot(often, tried.errors, axes=1), 1, 0)  # (D, 3) each
    with np.errstate(invalid="ignore"):
        out = dict(zip(CLASSES, (squared / cells).T, strict=True))
        histogram = np.tensordot(often, tried.histogram, axes=1)
        return out | {"ap": precision_area(histogram), "nll": often @ tried.surprise / histogram.sum(axis=(1, 2))}


def figures(found: Mapping[str, Sequence[Tried]]) -> dict[str, Any]:
    """By variant and by change: each figure's mean over seeds, their standard deviation, and the middle 95 % of draws of the test towns."""
    count = len(next(iter(found.values()))[0].surprise)
    whole, draws = np.ones((1, count), dtype=np.int64), resamples(count)
    means = {name: [drawn(one, whole) for one in seeds] for name, seeds in found.items()}
    anew = {name: [drawn(one, draws) for one in seeds] for name, seeds in found.items()}

    def told(values: Sequence[float], by_draw: Floats) -> dict[str, Any]:
        mean = float(np.mean(values))
        if math.isnan(mean):
            return {"mean": None, "spread": None, "interval": None}
        return {"mean": mean, "spread": float(np.std(values, ddof=1)) if len(values) > 1 else None, "interval": interval(by_draw)}

    def of(values: Mapping[str, list[dict[str, Floats]]], name: str, figure: str) -> Floats:
        return np.array([seed[figure] for seed in values[name]])  # (S, D)

    variants = {
        name: {figure: told(of(means, name, figure)[:, 0].tolist(), of(anew, name, figure).mean(axis=0)) for figure in FIGURES}
        | {"seeds": len(seeds), "steps": seeds[0].steps, "sha256": [one.sha256 for one in seeds]}
        for name, seeds in found.items()
    }
    changes = {
        what: {
            figure: told(
                (of(means, after, figure) - of(means, before, figure))[:, 0].tolist(),
                (of(anew, after, figure) - of(anew, before, figure)).mean(axis=0),
            )
            for figure in FIGURES
        }
        for what, before, after in PAIRS
    }
    return {"variants": variants, "changes": changes}


def markdown(held: Mapping[str, Any]) -> str:
    """The variants, and below them what each change does."""
    head = ["network", "image", "learned by", *FIGURES.values()]
    lines = [[*TITLES[name], *(_cell(of[figure]) for figure in FIGURES)] for name, of in held["variants"].items()]
    changes = [[what, *(_cell(of[figure], "+") for figure in FIGURES)] for what, of in held["changes"].items()]
    tables = ([head, ["---"] * len(head), *lines], [["change", *FIGURES.values()], ["---"] * (1 + len(FIGURES)), *changes])
    return "\n\n".join("\n".join(f"| {' | '.join(row)} |" for row in table) for table in tables)


def _cell(of: Mapping[str, Any], sign: str = "") -> str:
    if of["mean"] is None:
        return "–"
    spread = "" if of["spread"] is None else f" ± {of['spread']:.3f}"
    low, high = of["interval"]
    return f"{of['mean']:{sign}.3f}{spread} [{low:{sign}.3f}, {high:{sign}.3f}]"
