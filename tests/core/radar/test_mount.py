"""The field of view, beside bearing and distance as the sensor itself would measure them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount


@pytest.mark.parametrize("place", [SE2(3.7, 0.8, 0.8), SE2(-0.9, -0.6, -2.4), SE2(0.5, 0.7, math.pi)])
def test_a_point_is_seen_by_its_bearing_and_distance_from_the_sensor(place: SE2) -> None:
    mount = Mount(place, 1.1, 20.0)
    points = np.random.default_rng(1).uniform(-30, 30, (40, 50, 2))
    x, y = np.moveaxis(place.inverse().apply(points.reshape(-1, 2)), -1, 0)
    expected = [abs(math.atan2(side, ahead)) <= 1.1 and math.hypot(ahead, side) <= 20.0 for ahead, side in zip(x, y, strict=True)]
    np.testing.assert_array_equal(mount.sees(points), np.reshape(expected, (40, 50)))
    assert 0.05 < np.mean(expected) < 0.5
