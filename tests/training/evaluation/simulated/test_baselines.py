"""Plain methods on patches of a drive through a room, by what each of them must say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from msgspec import structs
from tests.support.networks import logits

from echogrid.core.evidence.history_raster import CHANNELS, COUNT
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid_training.evaluation.metrics import average_precision
from echogrid_training.evaluation.simulated.baselines import BASELINES, Counting, Delta, Elfes, NearestFill, mean_patch, observations
from echogrid_training.evaluation.simulated.learned import File, networks
from echogrid_training.evaluation.simulated.patches import Patch, patches
from echogrid_training.evaluation.simulated.tape import Tape
from echogrid_training.learning.dataset import SPEC
from echogrid_training.learning.unet import evenly


@pytest.fixture(scope="module")
def patch(room_tape: Tape) -> Patch:
    return list(patches(room_tape, 100))[-1]


def drawn(patch: Patch, **planes: np.ndarray) -> Patch:
    """With some planes as given, and nothing in the others."""
    image = np.zeros_like(patch.image)
    for name, plane in planes.items():
        image[CHANNELS.index(name)] = plane
    return replace(patch, image=image)


@pytest.mark.parametrize("name", BASELINES)
def test_all_of_them_answer_in_kind_and_find_walls(patch: Patch, name: str) -> None:
    occupied = (patch.place.truth > 0)[patch.place.counted]
    for method in BASELINES[name]:
        answer = method(patch)
        assert answer.scores.shape == (128, 128)
        assert answer.scores.dtype == np.float32
        assert np.isfinite(answer.scores).all()
        assert answer.label is None or (answer.label.shape == (128, 128) and np.abs(answer.label).max() <= 1)
        found = average_precision(answer.scores[patch.place.counted], occupied)
        assert found == pytest.approx(occupied.mean()) if name == "all unknown" else found > 1.2 * occupied.mean()


def test_counting_is_hits_over_hits_and_passes(patch: Patch) -> None:
    hits, passes = np.zeros((2, 128, 128), dtype=np.uint8)
    hits[1, 1], passes[1, 1] = COUNT[3], COUNT[1]
    hits[2, 2], passes[3, 3] = COUNT[2], COUNT[7]
    hits[4, 4], passes[4, 4] = COUNT[5], COUNT[5]
    answer = Counting("count_5m", 0.5)(drawn(patch, count_5m=hits, passes_5m=passes))
    p = 1 / (1 + np.exp(-answer.scores))
    assert p[1, 1] == pytest.approx(3.5 / 5)
    assert p[2, 2] == pytest.approx(2.5 / 3)
    assert p[3, 3] == pytest.approx(0.5 / 8)
    assert p[4, 4] == pytest.approx(0.5)
    assert np.count_nonzero(answer.scores) == 4  # even odds are no silence


def test_delta_marks_detections_alone(patch: Patch) -> None:
    answer = Delta("now")(patch)
    there = np.zeros(128 * 128, dtype=bool)
    cells = SPEC.locate(patch.around.now.points)
    there[cells[cells >= 0]] = True
    np.testing.assert_array_equal(answer.scores > 0, there.reshape(128, 128))
    np.testing.assert_array_equal(answer.label, there.reshape(128, 128))


def test_nearest_fill_falls_by_distance(patch: Patch) -> None:
    hit = np.zeros((128, 128), dtype=np.uint8)
    hit[10, 10], hit[50, 50] = COUNT[2], COUNT[1]
    scores = NearestFill(0.5, 2)(drawn(patch, updates_15m=hit)).scores
    assert scores[10, 10] == 1.0
    assert scores[10, 14] == pytest.approx(np.exp(-4 * SPEC.cell / 0.5))
    assert scores[50, 50] < 1e-6  # one update is not enough
    assert not NearestFill(0.5, 4)(drawn(patch, updates_15m=hit)).scores.any()


def test_elfes_of_the_history_is_the_sum_of_its_parts(patch: Patch) -> None:
    beam = BeamModel(free=-0.06, beam_sigma=0.02)
    past, early = patch.around.past, patch.around.age > 2.0
    parts = [replace(patch, around=structs.replace(patch.around, past=past.taken(np.flatnonzero(which)))) for which in (early, ~early)]
    whole = Elfes(True, beam, 1e3)(patch).scores
    np.testing.assert_allclose(whole, sum(Elfes(True, beam, 1e3)(part).scores for part in parts), atol=1e-4)
    np.testing.assert_allclose(Elfes(True, beam, 2.0)(patch).scores, np.clip(whole, -2, 2), atol=1e-6)


def test_regressions_are_given_every_cell_that_was_hit_and_as_many_free_ones(patch: Patch) -> None:
    """Free ones lie along rays, not where the ray ends: hardly any of them where truth has a wall."""
    cells, values = observations(patch)
    hit = SPEC.locate(patch.around.past.points)
    assert set(cells[values > 0].tolist()) == set(hit[hit >= 0].tolist())
    assert len(set(hit.tolist())) > 250
    assert (values > 0).sum() == (values < 0).sum()
    truth = patch.place.truth.reshape(-1)
    free = cells[values < 0]
    assert (truth[free] < 0).mean() > 0.9
    assert (truth[cells[values > 0]] > 0).mean() > 0.3


def test_the_mean_patch_is_what_was_where(patch: Patch) -> None:
    free, occupied = np.zeros((2, 128, 128))
    free[:, :64], occupied[:, 64:] = 10.0, 10.0
    answer = mean_patch(free, occupied, 10)(patch)
    assert answer.label is not None
    assert answer.label[64, 5] == pytest.approx(-1.0)
    assert answer.label[64, 120] == pytest.approx(1.0)
    assert (answer.scores[:, :50] < -4).all()
    assert (answer.scores[:, 80:] > 2).all()


def test_a_network_answers_as_the_service_and_the_paper_would(patch: Patch, room_tape: Tape, network_file: Path) -> None:
    (network,) = networks([File("tiny", network_file)], room_tape.mounts).values()
    answer, said = network.answer(patch), logits(patch.image)
    np.testing.assert_allclose(answer.scores, said[2] - said[0], atol=1e-4)
    np.testing.assert_allclose(answer.scores, network(patch.around)[0], atol=1e-5)
    expected = evenly(torch.from_numpy(said[None]).float(), torch.tensor((0.6, 0.35, 0.05)))[0].numpy()
    assert answer.label is not None
    np.testing.assert_allclose(answer.label, expected, atol=1e-4)
