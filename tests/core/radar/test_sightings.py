"""What a look keeps of scans, and which sightings are pairs: against rotation matrices, one detection at a time, and by hand."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.sightings import AZIMUTH_NOISE, EXTENT, LATEST_NS, RANGE_NOISE, SOONEST_NS, Look, Turned, look, pairs
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep

NOISE, DOCS = GateNoise(), Path(__file__).parents[3] / "docs"
TURNED = Turned(np.array((1.0, 0.2, 0.1)), np.array((1.0 + 2.0j, 3.0, 4.0j)))


def swept(distance: Floats, azimuth: Floats, rate: Floats) -> tuple[Sweep, SE2]:
    """Of a car that stands, so that what stands shows no range rate; and where the radar is."""
    mount, ego = Mount(SE2(3.0, -1.0, -0.7), 1.2, 50.0), EgoState(5, SE2(20.0, -4.0, 1.9), 0.0, 0.0)
    scan = RadarScan("r", 5, 5, distance, azimuth, rate, np.zeros(len(rate)))
    return Sweep.of([PlacedScan(scan, mount, ego)], NOISE), ego.odom_from_base @ mount.base_from_sensor


def test_a_sighting_lies_where_it_was_measured_as_surely_as_range_and_azimuth_are() -> None:
    rng = np.random.default_rng(0)
    distance, azimuth = rng.uniform(2.0, 40.0, 9), np.linspace(-1.2, 1.2, 9)
    sweep, sensor = swept(distance, azimuth, np.zeros(9))
    seen = look([(sweep, TURNED)], {"other": 0, "r": 1}, NOISE, 40)
    assert seen is not None
    assert set(seen.radars.tolist()) == {1}
    assert (seen.stamp_ns, seen.turned.sums.tolist(), seen.cars.tolist()) == (5, [TURNED.sums.tolist()] * 9, [20.0 - 4.0j] * 9)
    for n, (far, bearing) in enumerate(zip(distance, azimuth + sensor.yaw, strict=True)):
        turn = np.array(((math.cos(bearing), -math.sin(bearing)), (math.sin(bearing), math.cos(bearing))))
        own = turn @ np.diag((RANGE_NOISE**2, (far * AZIMUTH_NOISE) ** 2)) @ turn.T + EXTENT**2 * np.eye(2)
        np.testing.assert_allclose(seen.covariances[:, n], (own[0, 0], own[0, 1], own[1, 1]), rtol=1e-9, atol=1e-12)
        arm = far * complex(math.cos(bearing), math.sin(bearing))
        assert seen.arms[n] == pytest.approx(arm)
        assert seen.places[n] == pytest.approx(complex(sensor.x, sensor.y) + arm)


def test_the_errors_of_a_sighting_are_those_in_the_documentation() -> None:
    found = re.search(r"scatter is taken from what is left, ([\d.]+) m and ([\d.]+)° at first", (DOCS / "motion.md").read_text())
    assert found
    assert [float(text) for text in found.groups()] == [RANGE_NOISE, round(math.degrees(AZIMUTH_NOISE), 1)]


def test_movers_what_is_among_them_and_what_is_too_near_are_no_sightings() -> None:
    """Ahead of the radar, by distance: too near; a mover alone; what stands; two movers, and what seems to stand between them; the last."""
    distance = np.array((0.9, 6.0, 12.0, 20.0, 21.0, 22.0, 30.0))
    sweep, _ = swept(distance, np.zeros(7), np.array((0.0, 9.0, 0.0, 9.0, 0.0, 9.0, 0.0)))
    seen = look([(sweep, TURNED)], {"r": 0}, NOISE, 40)
    assert seen is not None
    np.testing.assert_allclose(np.abs(seen.arms), (12.0, 30.0))
    thinned = look([(sweep, TURNED)], {"r": 0}, NOISE, 1)
    assert thinned is not None
    assert len(thinned.arms) == 1
    still, _ = swept(distance[1:2], np.zeros(1), np.array((9.0,)))
    assert look([(still, TURNED)], {"r": 0}, NOISE, 40) is None


def looked(stamp_ns: int, place: complex, arm: float, radar: int = 0) -> Look:
    nothing = np.zeros((1, 3))
    return Look(
        *(stamp_ns, np.zeros(1, complex), Turned(nothing, nothing.astype(complex)), np.array((place,))),
        *(np.array((complex(arm),)), np.ones((3, 1)), np.array((radar,))),
    )


@pytest.mark.parametrize(
    ("later_ns", "apart", "arm", "radar", "is_one"),
    [
        (SOONEST_NS, 0.1, 10.0, 0, True),
        (SOONEST_NS - 1, 0.1, 10.0, 0, False),
        (LATEST_NS, 0.1, 10.0, 0, True),
        (LATEST_NS + 1, 0.1, 10.0, 0, False),
        (3_000_000_000, 0.1, 10.0, 1, False),  # another radar's
        (3_000_000_000, 2.99, 10.0, 0, True),  # 2.5 m and two sigmas of 0.025 rad, 10 m away
        (3_000_000_000, 3.01, 10.0, 0, False),
        (3_000_000_000, 4.49, 40.0, 0, True),
        (3_000_000_000, 4.51, 40.0, 0, False),
    ],
)
def test_which_sightings_are_a_pair(later_ns: int, apart: float, arm: float, radar: int, is_one: bool) -> None:
    found = pairs([looked(7, 2.0 + 1.0j, 10.0), looked(7 + later_ns, 2.0 + 1.0j + apart * 1j, arm, radar)], 1)
    assert len(found.apart) == is_one
    if is_one:
        assert found.apart[0] == pytest.approx(apart * 1j)
        assert found.covariances[:, 0].tolist() == [2.0] * 3
