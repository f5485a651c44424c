"""The yaw rate's bias of a drive that never stops: by the filter that learns it in the car."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from echogrid.core.messages import EgoMotion, RadarScan
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.odometry import Odometry
from echogrid.core.radar.doppler_errors import DopplerErrors
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.seen_again import SeenAgain
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep
from echogrid.judging.refining import Estimate

CYCLE_NS = 50_000_000


def bias_on_the_way(motion: Sequence[EgoMotion], scans: Sequence[RadarScan], mounts: Mapping[str, Mount], noise: GateNoise) -> Estimate:
    """rad/s, by the rear wheels' difference and by standing things that are seen again; motion and scans in any order.

    `mounts` and motion must be right but for small errors.
    """
    errors = ErrorFilter(tuple(mounts))
    odometry, doppler, again = Odometry(errors), DopplerErrors(), SeenAgain()
    waiting: list[RadarScan] = []
    gaps, end_ns = 0, -(2**63)
    for item in sorted([*motion, *scans], key=lambda one: one.stamp_ns):
        if item.stamp_ns >= end_ns:
            placed = [PlacedScan(scan, mounts[scan.sensor], ego) for scan in waiting if (ego := odometry.at(scan.stamp_ns)) is not None]
            if odometry.gaps > gaps:  # what is seen again is not where the poses say
                gaps = odometry.gaps
                doppler.restart()
                again.restart()
            doppler.add(placed, errors, noise)
            if placed:
                again.add(Sweep.of(placed, noise), errors, noise)
            waiting, end_ns = [], item.stamp_ns + CYCLE_NS
        if isinstance(item, RadarScan):
            waiting.append(item)
        else:
            odometry.add(item)
    learned = errors.learned()
    return Estimate(math.radians(learned["yaw_rate_bias_deg_s"]), math.radians(learned["yaw_rate_bias_deg_s_sigma"]))
