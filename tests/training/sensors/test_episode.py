"""The draws cover what they are to cover, and repeat."""

from __future__ import annotations

import math

import numpy as np

from echogrid_training.sensors.episode import Episode, draw_episode, paper_like, paper_sensors, sparse_sensors

DRAWN = [draw_episode(seed, "street") for seed in range(400)]


def covers(values: list[float], low: float, high: float) -> None:
    """All within [low, high], and the outer tenths of it are visited."""
    assert low <= min(values) < low + 0.1 * (high - low)
    assert high - 0.1 * (high - low) < max(values) <= high


def yaw_deg(episode: Episode, corner: int) -> float:
    return math.degrees(episode.corners[corner].mount.base_from_sensor.yaw)


def test_the_draws_cover_the_wanted_ranges() -> None:
    covers([math.log(one.density) for one in DRAWN], math.log(2.0), math.log(64.0))
    covers([yaw_deg(one, 0) for one in DRAWN], 25.0, 95.0)
    covers([yaw_deg(one, 2) for one in DRAWN], 120.0, 178.0)
    covers([one.radar.cycle for one in DRAWN], 0.050, 0.075)
    covers([math.degrees(one.radar.half_fov) for one in DRAWN], 50.0, 80.0)
    covers([one.radar.max_range for one in DRAWN], 40.0, 80.0)
    covers([one.motion.wheel_scale for one in DRAWN], 0.99, 1.01)
    covers([math.log(abs(math.degrees(one.motion.yaw_bias))) for one in DRAWN], math.log(0.02), math.log(0.5))
    covers([one.radar.doppler_outliers for one in DRAWN], 0.0, 0.15)
    covers([corner.range_rate_bias for one in DRAWN for corner in one.corners], -0.2, 0.2)
    covers([one.motion.yaw_latency for one in DRAWN], 0.010, 0.030)
    folded = [one.radar.ambiguity for one in DRAWN if one.radar.ambiguity > 0]
    covers(folded, 10.0, 60.0)
    assert 0.3 < len(folded) / len(DRAWN) < 0.5


def test_low_and_high_densities_are_equally_frequent() -> None:
    """Log-uniform: the median of 2 … 64 is their geometric mean."""
    assert 9.0 < np.median([one.density for one in DRAWN]) < 14.0


def test_faults_happen_to_some() -> None:
    lost = [one for one in DRAWN if any(corner.lost[1] > corner.lost[0] for corner in one.corners)]
    blocked = [one for one in DRAWN if any(corner.blockage > 0 for corner in one.corners)]
    assert 20 < len(lost) < 100
    assert 10 < len(blocked) < 70
    assert all(0 <= corner.lost[0] <= corner.lost[1] <= 1 and 0 <= corner.blockage <= 1 for one in DRAWN for corner in one.corners)


def test_radars_sit_on_the_car_and_mirror_each_other() -> None:
    for one in DRAWN:
        for left, right in ((0, 1), (2, 3)):
            a, b = (one.corners[index].mount.base_from_sensor for index in (left, right))
            assert (a.x, a.y, a.yaw) == (b.x, -b.y, -b.yaw)
            assert -one.body.rear_overhang <= a.x <= one.body.length - one.body.rear_overhang
            assert 0 < a.y <= one.body.width / 2
        assert one.corners[0].mount.base_from_sensor.x > one.corners[2].mount.base_from_sensor.x


def test_the_same_seed_draws_the_same_episode_and_each_family_another() -> None:
    assert draw_episode(5, "street") == DRAWN[5]
    assert draw_episode(5, "lot") != DRAWN[5] != DRAWN[6]


def test_the_papers_car() -> None:
    paper = paper_like()
    assert [round(yaw_deg(paper, corner)) for corner in range(4)] == [45, -45, 135, -135]
    assert 15 <= paper.density <= 35
    assert paper.radar.ambiguity == 0


def test_the_papers_car_on_many_drives() -> None:
    """Always the same radars in the same places; density, motion, mounting errors and dropped scans are drawn, and repeat."""
    many = [paper_sensors(seed, "street") for seed in range(400)]
    paper = paper_like()
    covers([one.density for one in many], 15.0, 35.0)
    for seed, one in enumerate(many):
        drawn = DRAWN[seed]
        assert (one.radar, one.body) == (paper.radar, paper.body)
        assert [corner.mount for corner in one.corners] == [corner.mount for corner in paper.corners]
        assert (one.motion, one.dropped) == (drawn.motion, drawn.dropped)
        assert [corner.azimuth_bias for corner in one.corners] == [corner.azimuth_bias for corner in drawn.corners]
        assert all(corner.lost == (0.0, 0.0) and corner.blockage == 0 for corner in one.corners)
    assert paper_sensors(5, "street") == many[5]
    assert paper_sensors(5, "lot").density != many[5].density


def test_sparse_radars_are_drawn_over_what_recorded_ones_show() -> None:
    """As other sensors on the same car: mounts, body and motion are those of the drawn episode; seeds repeat."""
    many = [sparse_sensors(seed, "street") for seed in range(400)]
    covers([math.log(one.density) for one in many], math.log(0.7), math.log(24.0))
    covers([math.log(one.radar.detour) for one in many], math.log(0.05), math.log(0.6))
    covers([one.radar.inward for one in many], 0.0, 0.8)
    covers([one.radar.cycle for one in many], 0.050, 0.100)
    covers([math.degrees(corner.azimuth_bias) for one in many for corner in one.corners], -2.0, 2.0)
    assert 0.4 < np.mean([one.radar.position_step == 0.2 for one in many]) < 0.6
    for seed, one in enumerate(many):
        drawn = DRAWN[seed]
        assert (one.body, one.motion) == (drawn.body, drawn.motion)
        assert [corner.mount for corner in one.corners] == [corner.mount for corner in drawn.corners]
        biases = [corner.range_bias for corner in one.corners]
        assert np.ptp(biases) < 0.6  # one kind of radar
        assert one.radar.centroids
    assert sparse_sensors(5, "street") == many[5]
    assert sparse_sensors(5, "lot") != many[5]
