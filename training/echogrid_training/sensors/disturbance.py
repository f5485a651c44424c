"""What may happen to radars between one moment and the next: fewer detections, and sensors that fall silent.

A network that always met four radars of one density calls silence free space.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from echogrid.core.messages import RadarScan

SPELL_NS = 8_000_000_000  # how long a draw lasts
WHOLE = 0.5  # share of spells without thinning
LEAST = 0.25  # share of detections that the strongest thinning leaves
LOST = 0.1  # probability that a radar is silent for a spell
NO_RCS = 0.1  # share of spells in which the sensors report no cross-section


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Callable: a scan as it came -> what is left of it, None where it is lost. The same seed does the same to the same scan."""

    seed: int

    def __call__(self, scan: RadarScan) -> RadarScan | None:
        spell = scan.stamp_ns // SPELL_NS
        rng = np.random.default_rng((self.seed, spell))
        kept = 1.0 if rng.uniform() < WHOLE else rng.uniform(LEAST, 1.0)
        mute = rng.uniform() < NO_RCS
        if np.random.default_rng((self.seed, spell, *scan.sensor.encode())).uniform() < LOST:
            return None
        chosen = np.random.default_rng((self.seed, scan.stamp_ns)).uniform(size=len(scan)) < kept
        rcs = np.full(len(scan), np.nan) if mute else scan.rcs
        return msgspec.structs.replace(
            scan, range=scan.range[chosen], azimuth=scan.azimuth[chosen], range_rate=scan.range_rate[chosen], rcs=rcs[chosen]
        )
