"""The best weights are the first with the least loss, and patience ends after so many that were no better."""

from __future__ import annotations

import torch
from torch import nn

from echogrid_training.learning.best import Best


def test_patience_is_counted_from_the_last_that_was_better() -> None:
    best, model = Best(2), nn.Linear(1, 1)
    stale = []
    for number, loss in enumerate((3.0, 2.0, 2.0, 2.5, 1.0, 1.0, 1.0)):
        nn.init.constant_(model.bias, number)
        stale.append(best.stale(model, loss))
    assert stale == [False, False, False, True, False, False, True]
    assert torch.equal(best.weights["bias"], torch.tensor([4.0]))
    assert best.least == 1.0
