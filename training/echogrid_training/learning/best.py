"""Early stopping: the weights that did best on what was not learned from."""

from __future__ import annotations

import copy
import math

from torch import Tensor, nn


class Best:
    """Remembers the weights with the least loss, and how often in a row there was none less."""

    def __init__(self, patience: int) -> None:
        self.patience = patience
        self.least, self.waited = math.inf, 0
        self.weights: dict[str, Tensor] = {}

    def stale(self, model: nn.Module, loss: float) -> bool:
        """Takes note of a model and its loss; True once `patience` of them in a row were no better."""
        self.waited += 1
        if loss < self.least or not self.weights:
            self.least, self.waited, self.weights = loss, 0, copy.deepcopy(model.state_dict())
        return self.waited >= self.patience
