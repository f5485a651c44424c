"""Where beams go and end, by hand."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.evidence.beams import Beams, Reach


def test_rays_of_a_beam_end_as_far_from_its_radar_as_what_it_measured() -> None:
    """From (3, 1) to (6, 5), 5 m; rays are turned about the radar, not about the origin."""
    beams = Beams(np.array(((6.0, 5.0), (3.0, 1.0))), np.array(((3.0, 1.0), (3.0, 1.0))), np.ones(2, np.uint16))
    reach = Reach.of(beams, np.array((-1.0, 0.0, 2.0)), np.array((0.2, 0.6, 0.2)), 0.1)
    np.testing.assert_allclose(reach.distance, (5.0, 0.0))
    ends, bearing = reach.ends(beams), math.atan2(4.0, 3.0)
    for n, turn in enumerate((-0.1, 0.0, 0.2)):
        np.testing.assert_allclose(ends[0, n], (3.0 + 5.0 * math.cos(bearing + turn), 1.0 + 5.0 * math.sin(bearing + turn)))
    np.testing.assert_allclose(ends[1], 3 * [(3.0, 1.0)])
