"""Samples: the service's own images beside the truth at the same place."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from tests.training.tiny_towns import room, town, track

from echogrid.core.raster import GridSpec
from echogrid_training.drive import write_drive
from echogrid_training.episode import paper_like
from echogrid_training.ground_truth import ternary
from echogrid_training.samples import Sample, samples
from echogrid_training.simulate import simulate


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> list[Sample]:
    folder = tmp_path_factory.mktemp("samples") / "drive"
    recording, truth = simulate(town(*room(28.0, 14.0), ego=track(3.0, speed=3.0)), paper_like(2))
    write_drive(recording, folder, truth_map=truth)
    return list(samples(folder))


def test_images_and_truth_show_the_same_walls(found: list[Sample]) -> None:
    """Most of the drawn detections lie within a cell or two of a true wall: same frame, same rows and columns, same signs."""
    spec = GridSpec()
    near = drawn = 0
    for sample in found:
        assert sample.image.shape == (1, spec.cells, spec.cells)
        assert set(np.unique(sample.image)) == {-1.0, 1.0}
        walls = np.argwhere(ternary(sample.truth) == 1)
        for cell in np.argwhere(sample.image[0] > 0):
            drawn += 1
            near += bool(np.abs(walls - cell).max(axis=1).min() <= 2)
    assert drawn > 200
    assert near / drawn > 0.8


def test_samples_keep_their_distance(found: list[Sample]) -> None:
    for one, other in pairwise(found):
        there, here = other.truth_from_base, one.truth_from_base
        assert math.hypot(there.x - here.x, there.y - here.y) >= 0.5
        assert other.stamp_ns > one.stamp_ns
    assert 10 <= len(found) <= 18
