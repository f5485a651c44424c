"""The paper's four autoencoders: a lidar's or the radars' image, by one or the other class weighting; trained, judged and asked."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.core.evidence.raster import Image
from echogrid.core.messages import Floats
from echogrid_training.learning.dataset import Samples
from echogrid_training.learning.judging import errors, inferred
from echogrid_training.learning.loss import Weighting
from echogrid_training.learning.recipe import Sensor
from echogrid_training.learning.train import LOG, MODEL, Settings, Trained, fit
from echogrid_training.recording import Track

PAPERS: Mapping[tuple[Sensor, Weighting], tuple[float, float]] = {  # Table I: MSE of free and of occupied cells
    ("lidar", "inverse"): (0.14, 1.46),
    ("lidar", "independent"): (0.49, 0.55),
    ("radar", "inverse"): (0.19, 1.82),
    ("radar", "independent"): (0.70, 0.69),
}


@dataclass(frozen=True, slots=True, eq=False)
class Autoencoder:
    """One of the four, from one seed: as trained, the errors in each test town, and its log, a line an epoch."""

    trained: Trained
    towns: dict[str, Floats]  # 'ternary' and 'soft' labels -> (T, 2, 3), loss.class_sums of each town
    log: list[dict[str, Any]]
    sha256: str  # of its file

    @property
    def sensor(self) -> Sensor:
        return self.trained.settings.sensor

    @property
    def weighting(self) -> Weighting:
        return self.trained.settings.weighting

    @property
    def name(self) -> str:
        """Of its folder and its pictures."""
        return f"{self.sensor}-{self.weighting}-{self.trained.settings.seed}"

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.sensor}, {self.weighting}"

    def answers(self, samples: Samples) -> Image:
        """(n, 128, 128) log-odds, as the network gives them."""
        recipe, model = self.trained.recipe(), self.trained.model()
        return np.concatenate([recipe.log_odds(output).numpy() for output, _ in inferred(recipe, model, samples)])


def reproduce(
    learned: Samples, held_out: Samples, towns: Sequence[Samples], settings: Sequence[Settings], out: Path, *, resume: bool, track: Track
) -> list[Autoencoder]:
    """Trains the four in the order of the paper's table, from each seed, each in a folder of `out` named for it.

    `settings`: of the paper's network, one for each seed; sensor and weighting are put in here. All four learn from the same samples in the
    same steps. Raises EchogridError as train.fit does.
    """
    out_of = []
    digest = learned.digest()
    for sensor, weighting in PAPERS:
        for seed in settings:
            of_this = replace(seed, sensor=sensor, weighting=weighting)
            folder = out / f"{sensor}-{weighting}-{seed.seed}"
            trained = fit(learned, held_out, of_this, folder, resume=resume, track=track, data_sha256=digest)
            log = [json.loads(line) for line in (folder / LOG).read_text("utf-8").splitlines()]
            sha256 = hashlib.sha256((folder / MODEL).read_bytes()).hexdigest()
            out_of.append(Autoencoder(trained, judged(trained, towns), log, sha256))
    return out_of


def judged(trained: Trained, towns: Sequence[Samples]) -> dict[str, Floats]:
    """As Autoencoder.towns."""
    recipe, model = trained.recipe(), trained.model()
    sums = [errors(recipe, model, town) for town in towns]
    return {labels: np.stack([town[labels].numpy() for town in sums]) for labels in ("ternary", "soft")}
