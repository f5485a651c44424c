"""The paper's four autoencoders: a lidar's or the radars' image, by one or the other class weighting; trained, judged and asked."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.core.evidence.raster import Image
from echogrid_training.learning.dataset import Samples
from echogrid_training.learning.loss import Weighting
from echogrid_training.learning.recipe import Sensor
from echogrid_training.learning.train import LOG, Settings, Trained, fit, inferred, judge
from echogrid_training.recording import Track

PAPERS: Mapping[tuple[Sensor, Weighting], tuple[float, float]] = {  # Table I: MSE of free and of occupied cells
    ("lidar", "inverse"): (0.14, 1.46),
    ("lidar", "independent"): (0.49, 0.55),
    ("radar", "inverse"): (0.19, 1.82),
    ("radar", "independent"): (0.70, 0.69),
}

Errors = dict[str, dict[str, float]]  # 'ternary' and 'soft' labels -> class MSE of free, unknown and occupied cells


@dataclass(frozen=True, slots=True, eq=False)
class Autoencoder:
    """One of the four: as trained, its errors in the test towns, and its log, a line an epoch."""

    trained: Trained
    errors: Errors
    log: list[dict[str, Any]]

    @property
    def sensor(self) -> Sensor:
        return self.trained.settings.sensor

    @property
    def weighting(self) -> Weighting:
        return self.trained.settings.weighting

    @property
    def name(self) -> str:
        """Of its folder and its pictures."""
        return f"{self.sensor}-{self.weighting}"

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.sensor}, {self.weighting}"

    def answers(self, samples: Samples) -> Image:
        """(n, 128, 128) log-odds, as the network gives them."""
        recipe, model = self.trained.recipe(), self.trained.model()
        return np.concatenate([recipe.log_odds(output).numpy() for output, _ in inferred(recipe, model, samples)])


def reproduce(
    learned: Samples, held_out: Samples, test: Samples, settings: Settings, out: Path, *, resume: bool, track: Track
) -> list[Autoencoder]:
    """Trains the four in the order of the paper's table, each in a folder of `out` named for it.

    `settings`: of the paper's network; sensor and weighting are put in here. Raises EchogridError as train.fit does.
    """
    four = []
    digest = learned.digest()
    for sensor, weighting in PAPERS:
        of_this = replace(settings, sensor=sensor, weighting=weighting)
        folder = out / f"{sensor}-{weighting}"
        trained = fit(learned, held_out, of_this, folder, resume=resume, track=track, data_sha256=digest)
        log = [json.loads(line) for line in (folder / LOG).read_text("utf-8").splitlines()]
        four.append(Autoencoder(trained, judge(trained.recipe(), trained.model(), test), log))
    return four
