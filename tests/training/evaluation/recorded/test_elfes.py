"""The plain Elfes map against the same drawn ray by ray and step by step."""

from __future__ import annotations

import math

import numpy as np

from echogrid_training.evaluation.recorded.drive import Reflections
from echogrid_training.evaluation.recorded.elfes import along, once, plain_elfes
from echogrid_training.evaluation.recorded.scores import Rectangle

CELL = 30.0 / 128
WHERE = Rectangle(-130, -120, 260, 250, CELL)


def drawn_scans(count: int = 6) -> list[Reflections]:
    rng = np.random.default_rng(1)
    return [Reflections(rng.uniform(-3, 3, 2), rng.uniform(0.31, 20.9, 40), rng.uniform(-9, 9, 40)) for _ in range(count)]


def slow(scans: list[Reflections]) -> np.ndarray:
    log_odds = np.zeros((WHERE.height, WHERE.width))

    def cell(scan: Reflections, distance: float, bearing: float) -> tuple[int, int]:
        x, y = scan.origin[0] + distance * math.cos(bearing), scan.origin[1] + distance * math.sin(bearing)
        return math.floor(y / CELL) - WHERE.row, math.floor(x / CELL) - WHERE.column

    for scan in scans:
        for distance, bearing in zip(scan.range.tolist(), scan.bearing.tolist(), strict=True):
            if distance < 0.5:
                continue
            for passed in {cell(scan, way, bearing) for way in np.arange(0.3, distance - 0.3, CELL)}:
                log_odds[passed] -= 0.12
            for sigmas in (-1, 0, 1):
                log_odds[cell(scan, distance, bearing + sigmas * math.radians(1.5))] += 0.425 if sigmas else 0.85
        log_odds = np.clip(log_odds, -3.5, 3.5)
    return log_odds


def test_it_is_the_reference_scores_map() -> None:
    scans = drawn_scans()
    np.testing.assert_allclose(plain_elfes(scans, WHERE), slow(scans), atol=1e-5)


def test_no_scans_say_nothing() -> None:
    empty = Reflections(np.zeros(2), np.empty(0), np.empty(0))
    assert not plain_elfes([], WHERE).any()
    assert not plain_elfes([empty], WHERE).any()


def test_rays_begin_and_end_where_they_are_told_to() -> None:
    points, ray = along(np.array((1.0, 2.0)), np.array((0.0, math.pi / 2)), np.array((1.0, 0.2)), first=0.25, step=0.25)
    np.testing.assert_allclose(points, [(1.25, 2.0), (1.5, 2.0), (1.75, 2.0)])
    assert ray.tolist() == [0, 0, 0]
    assert sorted(once(np.array((5, 5, -1, 5)), np.array((0, 0, 0, 1)), 100).tolist()) == [5, 5]
