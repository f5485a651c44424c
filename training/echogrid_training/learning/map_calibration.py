"""How the mean of a network's answers is read out of the default map: fitted on towns of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from echogrid.core.map.look_map import Calibration
from echogrid_training.learning.logistic import fit_logistic
from echogrid_training.recording import Track, untracked
from echogrid_training.truth.local_map import local_maps

LEAST_WEIGHT = 0.05  # of a look: what a network hardly holds for observable says nothing to calibrate by


def calibrate_map(drives: Sequence[Path], model: Path, track: Track = untracked) -> Calibration:
    """Of a network's file, by greatest likelihood over all cells that truth and map know, along simulated drives it has not learned from.

    The sum of the geometry's log-odds was tried as a third term: it came out at a thirtieth of the network's weight and added nothing.
    The network's own log-odds where there is no such cell. Raises EchogridError.
    """
    means, occupied = [], []
    for drive in track(list(drives), "calibrating the map"):
        for local in local_maps(drive, str(model)):
            total, weight = local.layers[:2]
            known = (local.truth != 0) & (weight > LEAST_WEIGHT)
            means.append(total[known] / weight[known])
            occupied.append(local.truth[known] > 0)
    if not means:
        return Calibration()
    mean = np.concatenate(means).astype(float)
    learned, offset = fit_logistic(np.stack((mean, np.ones_like(mean))), np.concatenate(occupied), np.array([1.0, 0.0])).tolist()
    return Calibration(round(learned, 4), round(offset, 4))
