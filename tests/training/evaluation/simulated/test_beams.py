"""Elfes' beams of many detections at once: the service's analytic model, where that knows as much."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.evidence.inverse_sensor_model import AnalyticSensorModel, BeamModel
from echogrid.core.evidence.raster import GridSpec, rasterize
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid_training.evaluation.simulated import beams
from echogrid_training.evaluation.simulated.beams import traced

SPEC = GridSpec(64, 0.25)
MOUNTS = [
    Mount(SE2(x, y, math.radians(yaw)), math.radians(75), 25.0)
    for x, y, yaw in ((3.7, 0.8, 45), (3.7, -0.8, -45), (-0.9, 0.8, 135), (-0.9, -0.8, -135))
]


def detections(seed: int, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """In the middle of different cells, each from the nearest radar that sees it: what an image leaves of a scan."""
    rng = np.random.default_rng(seed)
    points = SPEC.centres().reshape(-1, 2)[rng.permutation(SPEC.cells**2)[:count]]
    seen = np.stack([mount.sees(points) for mount in MOUNTS])
    places = np.array([(mount.base_from_sensor.x, mount.base_from_sensor.y) for mount in MOUNTS])
    distance = np.where(seen, np.hypot(*(points[None] - places[:, None]).transpose(2, 0, 1)), np.inf)
    kept = seen.any(axis=0)
    return points[kept], places[distance.argmin(axis=0)[kept]]


def test_the_services_answer_for_the_same_detections() -> None:
    for seed, beam in enumerate((BeamModel(), BeamModel(occupied=2.0, free=-0.3, beam_sigma=0.05))):
        points, origins = detections(seed)
        passed, ended = traced(points, origins, SPEC, beam)
        expected = AnalyticSensorModel(SPEC, MOUNTS, beam)(rasterize(points, SPEC))
        np.testing.assert_allclose(beam.free * passed + beam.occupied * ended, expected, atol=1e-5)


def test_portions_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    points, origins = detections(5)
    whole = traced(points, origins, SPEC, BeamModel())
    monkeypatch.setattr(beams, "MOST_POINTS", 500)
    np.testing.assert_allclose(traced(points, origins, SPEC, BeamModel()), whole)


def test_detections_add_up_and_none_is_nothing() -> None:
    points, origins = detections(3)
    one, other = traced(points[:20], origins[:20], SPEC, BeamModel()), traced(points[20:], origins[20:], SPEC, BeamModel())
    np.testing.assert_allclose(traced(points, origins, SPEC, BeamModel()), one + other)
    assert not traced(np.empty((0, 2)), np.empty((0, 2)), SPEC, BeamModel()).any()


def test_ends_outside_the_patch_still_pass_through_it() -> None:
    passed, ended = traced(np.array([[30.0, 0.0]]), np.array([[3.7, 0.0]]), SPEC, BeamModel())
    assert not ended.any()
    assert passed[32].sum() + passed[31].sum() > 10
