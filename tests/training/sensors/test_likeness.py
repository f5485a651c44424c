"""Towns seen as a car sees them: what its drives show is kept in every town, and what they cannot tell is not the same twice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from echogrid.config.tables import Body
from echogrid.core.messages import RadarScan
from echogrid_training.recording import Motion, Recording, Truth
from echogrid_training.sensors.episode import NEAR
from echogrid_training.sensors.likeness import Likeness, Radar, as_loud, episode_like

BODY = Body(length=4.2, width=1.8, rear_overhang=0.9)
RADARS = tuple(
    Radar(name, x, y, math.radians(yaw), math.radians(140.0), math.radians(bias), math.radians(0.5))
    for name, x, y, yaw, bias in (("nose", 3.3, 0.0, 0.0, 1.5), ("left", 1.0, 0.9, 90.0, -1.0), ("right", 1.0, -0.9, -90.0, 0.0))
)
CAR = Likeness(BODY, RADARS, cycle=0.066, density=11.0, most=40, reach=48.0, ambiguity=20.0, rcs=-7.0)


def test_what_was_seen_is_kept_and_the_rest_is_drawn() -> None:
    many = [episode_like(CAR, seed, "street") for seed in range(300)]
    for one in many:
        radar = one.radar
        assert (one.body, one.density, radar.cycle, radar.most, radar.max_range, radar.ambiguity) == (BODY, 11.0, 0.066, 40, 48.0, 20.0)
        assert [(corner.mount.name, corner.mount.base_from_sensor.x) for corner in one.corners] == [(own.name, own.x) for own in RADARS]
        assert radar.half_fov == pytest.approx(math.radians(70.0))
    biases = np.degrees([[corner.azimuth_bias for corner in one.corners] for one in many])
    np.testing.assert_allclose(biases.mean(axis=0), (1.5, -1.0, 0.0), atol=0.1)
    np.testing.assert_allclose(biases.std(axis=0), 0.5, atol=0.1)
    assert len({one.radar.range_resolution for one in many}) == 300
    assert 100 < sum(one.radar.centroids for one in many) < 200  # clusters
    assert not any(episode_like(replace(CAR, density=60.0), seed, "street").radar.centroids for seed in range(50))
    assert episode_like(CAR, 5, "street") == many[5] != episode_like(CAR, 5, "lot")


def test_the_median_cross_section_is_the_cars() -> None:
    rng = np.random.default_rng(1)
    scans = [
        RadarScan("nose", stamp, stamp, rng.uniform(1.0, 40.0, 31), np.zeros(31), np.zeros(31), rng.normal(-20.0, 9.0, 31))
        for stamp in range(9)
    ]
    empty = np.empty(0)
    recording = Recording("car", BODY, (), scans, Motion(empty, empty, empty, empty), Truth(empty, empty, empty, empty))
    for rcs in (-7.0, None):
        loud = np.concatenate([scan.rcs[scan.range < NEAR] for scan in as_loud(recording, rcs).scans])
        if rcs is None:
            assert np.isnan(loud).all()
        else:
            assert np.median(loud) == pytest.approx(rcs)
            assert np.ptp(loud) == pytest.approx(np.ptp(np.concatenate([scan.rcs[scan.range < NEAR] for scan in scans])))
