"""What each part of the evidence may do, as docs/fusion.md states it."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.support.places import DOCS

from echogrid.core.map.read_out import read_out

SURELY_FREE = float(np.log(0.1 / 0.9))


def read(learned: float, hits: float = 0, near: float | None = None, passes: float = 0) -> float:
    """One cell; a reflection in it is one beside it too."""
    beside = 2.7 * hits if near is None else near
    return float(read_out(np.array([[[value]] for value in (learned, 1, hits, beside, passes)], np.float32))[0, 0])


@pytest.mark.parametrize("learned", [-12.0, -4.0, 0.0, 4.0])
def test_hits_from_several_places_make_a_cell_occupied_whatever_the_network_says(learned: float) -> None:
    assert read(learned, hits=3, passes=2) > 0
    assert read(learned, hits=10, passes=10) > 0


def test_what_outweighs_what_is_as_the_document_says() -> None:
    text, n = (DOCS / "fusion.md").read_text(), r"(−?[\d.]+)"

    def told(pattern: str) -> list[float]:
        (found,) = re.findall(pattern, text)
        return [float(number.replace("−", "-")) for number in found]

    def p(log_odds: float) -> float:
        return 1 / (1 + float(np.exp(-log_odds)))

    passed, least, once, twice = told(rf"a look with one outweighs {n} passed(?s:.*)\(z below {n}\), a look with one says {n}, two {n},")
    assert read(0.0, hits=1, passes=passed) > 0 > read(0.0, hits=1, passes=passed + 1)
    assert [p(read(least - 0.1, hits)) for hits in (1, 2)] == pytest.approx([once, twice], abs=0.005)
    assert read(least - 0.1, hits=1) == read(-20.0, hits=1) < read(least + 0.1, hits=1)
    assert read(-20.0, hits=3, passes=2) > 0 > read(-20.0, hits=3, passes=3)
    alone, surest = told(rf"z below {n}, which alone makes it no surer than p = {n}\.")
    assert p(read(alone - 0.01)) < 0.1 < p(read(alone + 0.01))
    assert p(read(-40.0)) == pytest.approx(surest, abs=0.0006)


@pytest.mark.parametrize("learned", [-12.0, -4.0, 0.0, 4.0])
def test_nothing_is_surely_free_beside_a_hit_that_few_beams_passed(learned: float) -> None:
    assert read(learned, near=2.7, passes=1) > SURELY_FREE
    assert read(learned, near=8.1, passes=2) > SURELY_FREE


def test_many_passes_and_a_network_that_agrees_make_a_cell_surely_free() -> None:
    assert read(-4.0, passes=10) < SURELY_FREE
    assert read(-4.0, near=1.7, passes=30) < SURELY_FREE
    assert read(4.0, passes=3) > SURELY_FREE


def test_more_of_each_part_moves_a_cell_its_way() -> None:
    rng = np.random.default_rng(1)
    learned, hits, near, passes = rng.normal(-2, 3, 4000), rng.integers(0, 5, 4000), rng.uniform(0, 9, 4000), rng.integers(0, 40, 4000)
    here = np.array((learned, np.ones(4000), hits, near, passes), np.float32)
    before = read_out(here)
    for part, sign in ((0, 1), (2, 1), (3, 1), (4, -1)):
        more = here.copy()
        more[part] += 1
        assert (sign * (read_out(more) - before) >= -1e-5).all()


def test_what_is_not_free_says_more_than_10_percent_when_it_is_rounded_too() -> None:
    rng = np.random.default_rng(3)
    layers = rng.uniform(0, 12, (5, 40, 400)).astype(np.float32) * (rng.uniform(size=(5, 40, 400)) < 0.6)
    layers[0] = rng.normal(-8, 5, (40, 400)) * layers[1]
    log_odds = read_out(layers)
    p = 1 / (1 + np.exp(-log_odds[log_odds != 0].astype(float)))
    free = p < 0.1 + 1e-6
    assert min(free.sum(), (~free & (p < 0.12)).sum(), (p > 0.5).sum()) > 500
    assert (np.round(100 * p[~free]) > 10).all()


@pytest.mark.parametrize("value", [1e-3, 2.0])  # 2 has one bit alone
def test_unknown_is_0_and_known_never(value: float) -> None:
    alone = np.zeros((5, 5, 150), np.float32)
    for layer in range(5):
        alone[layer, layer, 70 + layer] = value  # a network that is undecided, a weight without log-odds, and the like
    assert ((read_out(alone) != 0) == alone.any(axis=0)).all()


def test_a_network_that_holds_a_cell_for_occupied_is_believed_until_beams_passed_often() -> None:
    assert read(0.5) > 0
    assert read(0.5, passes=2) > 0
    assert read(6.0, passes=60) < 0


def test_it_does_not_matter_how_the_layers_lie_in_memory() -> None:
    layers = np.random.default_rng(3).uniform(0, 3, (5, 7, 9)).astype(np.float32)
    expected = read_out(layers)
    assert np.array_equal(read_out(layers.transpose(0, 2, 1)), expected.T)
    assert np.array_equal(read_out(np.asfortranarray(layers)), expected)
    assert np.array_equal(read_out(layers[:, ::2, ::-1]), expected[::2, ::-1])


def test_log_odds_are_by_the_document_s_formula() -> None:
    """In doubles; with its numbers, but for p = 0.1 and 0.106, which it rounds."""
    rng, count = np.random.default_rng(7), 3001
    layers = (rng.uniform(0, 6, (5, count)) * (rng.uniform(size=(5, count)) < 0.7)).astype(np.float32)
    layers[0] = (rng.normal(-3, 4, count) * layers[1]).astype(np.float32)
    layers[2, 1000:], layers[4] = 0, 5 * layers[4]
    total, weight, hits, near, passes = layers[:, layers.any(axis=0)].astype(float)
    z = np.where(weight > 0, 1.3 * total / np.maximum(weight, 1e-6) - 0.4, 0.0)
    free = np.log(0.4 * passes**1.25 + 2.8)
    prior = np.clip(0.372 * z, -2.8, 1.7) - free
    inside, beside = prior + np.log(21 * hits + 2.8), prior + np.log(2.2 * near + 2.8)
    beside = np.where(beside > SURELY_FREE, SURELY_FREE + 0.38 * (beside - SURELY_FREE), beside)
    alone = np.where(z == 0, -np.inf, np.minimum(4 * z + 2, 3.3) - free)
    everything = 0.5 * np.log(np.exp(2 * inside) + np.exp(2 * beside) + np.exp(2 * alone))
    least = np.log(0.106 / 0.894)
    expected = np.where(everything < SURELY_FREE, SURELY_FREE + 4.2 * (everything - SURELY_FREE), 0.72 * everything)
    between = (everything >= SURELY_FREE) & (everything < 0)
    expected[between] = least * (1 - (1 - everything[between] / SURELY_FREE) ** 3)
    assert min((everything < SURELY_FREE).sum(), between.sum(), (everything > 0).sum()) > 200
    np.testing.assert_allclose(read_out(layers, 1.3, -0.4)[layers.any(axis=0)], expected, atol=2e-4)
