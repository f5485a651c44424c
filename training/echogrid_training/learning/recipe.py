"""What a network is shown, what it is to answer, and what its answer means: the two ways that `fit` knows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from echogrid_training.learning.autoencoder import PaperAutoencoder
from echogrid_training.learning.dataset import UNJUDGED, Labels, Samples, mirrored, of_detections, of_lidar, soft, ternary, turned
from echogrid_training.learning.loss import Weighting, reconstruction_loss
from echogrid_training.learning.unet import CLASS_WEIGHTS, CLASSES, PLANES, UNet, corrected, evenly

Network = Literal["paper", "default"]
Sensor = Literal["radar", "lidar"]
IGNORED = 99  # in a label's place: no class
Body = Literal["unet", "autoencoder"]
Kind = Literal["ternary", "soft"]  # labels: -1, 0, 1 as the paper's classes are written, or tanh(L / 2)


class Recipe(ABC):
    """One network's input, loss and read-out."""

    @abstractmethod
    def network(self) -> nn.Module:
        """With random weights."""

    @abstractmethod
    def shown(self, samples: Samples, rng: np.random.Generator | None = None) -> tuple[Tensor, Tensor]:
        """Input and labels (n, H, W) in [-1, 1] as float tensors; with `rng` augmented."""

    @abstractmethod
    def loss(self, output: Tensor, label: Tensor) -> Tensor:
        """Scalar."""

    @abstractmethod
    def log_odds(self, output: Tensor) -> Tensor:
        """(n, H, W) of occupied, before calibration."""

    @abstractmethod
    def label(self, output: Tensor) -> Tensor:
        """(n, H, W) in [-1, 1]: the answer in the paper's terms, which its class MSE judges."""


@dataclass(frozen=True, slots=True)
class Paper(Recipe):
    """The paper's autoencoder, its loss and its augmentation."""

    width: int
    weighting: Weighting
    labels: Kind
    sensor: Sensor = "radar"

    def network(self) -> nn.Module:
        return PaperAutoencoder(self.width)

    def shown(self, samples: Samples, rng: np.random.Generator | None = None) -> tuple[Tensor, Tensor]:
        drawn = of_lidar(samples.lidar) if self.sensor == "lidar" else of_detections(samples.images)
        labels = samples.labels
        if rng is not None:
            drawn, labels = turned(drawn, labels, rng)
        return torch.from_numpy(drawn), torch.from_numpy(ternary(labels) if self.labels == "ternary" else soft(labels))

    def loss(self, output: Tensor, label: Tensor) -> Tensor:
        return reconstruction_loss(output, label, self.weighting)

    def log_odds(self, output: Tensor) -> Tensor:
        return output

    def label(self, output: Tensor) -> Tensor:
        return torch.tanh(output / 2)


@dataclass(frozen=True, slots=True)
class Default(Recipe):
    """Three classes by cross-entropy, a proper scoring rule. What ships is the U-Net with history; without either, it is to compare."""

    shares: tuple[float, float, float]  # of free, unknown and occupied in what is learned from
    body: Body = "unet"
    planes: int = PLANES  # of the image, from the first on: 1 are the newest scans alone, as the paper's network sees them
    width: int = 16  # of the autoencoder

    def network(self) -> nn.Module:
        return UNet(planes=self.planes) if self.body == "unet" else PaperAutoencoder(self.width, self.planes, CLASSES)

    def shown(self, samples: Samples, rng: np.random.Generator | None = None) -> tuple[Tensor, Tensor]:
        images, labels = samples.images[:, : self.planes], samples.labels
        if rng is not None:
            images, labels = mirrored(images, labels, rng)
        shown = np.where(labels == UNJUDGED, np.float32(IGNORED), ternary(labels))
        return torch.from_numpy(images).float() / 255, torch.from_numpy(shown)

    def loss(self, output: Tensor, label: Tensor) -> Tensor:
        weight = torch.tensor(CLASS_WEIGHTS, device=output.device)
        return cross_entropy(output, label.long() + 1, weight=weight, ignore_index=IGNORED + 1)

    def log_odds(self, output: Tensor) -> Tensor:
        """Of occupied against free, where a cell is observable at all."""
        logits = corrected(output)
        return logits[:, 2] - logits[:, 0]

    def label(self, output: Tensor) -> Tensor:
        return evenly(corrected(output), torch.tensor(self.shares))


def shares(labels: Labels) -> tuple[float, float, float]:
    """Of free, unknown and occupied cells among those that are judged, none of them 0."""
    counts = [np.count_nonzero((labels < 0) & (labels != UNJUDGED)), np.count_nonzero(labels == 0), np.count_nonzero(labels > 0)]
    total = float(max(sum(counts), 1))
    free, unknown, occupied = (max(float(count), 1.0) / total for count in counts)
    return free, unknown, occupied
