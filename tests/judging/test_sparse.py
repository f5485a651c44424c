"""Sparse radars that bend azimuths: the yaw's sigma covers it, and no mount is blamed."""

from __future__ import annotations

import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echogrid.can.intake.frames import FrameBatch
from echogrid.config.loading import load_config
from echogrid.judging.judge import judge
from echogrid.judging.listening import Listener
from echogrid.judging.recorded import RadarTrack, Recorded
from tests.judging.trial import winding


@pytest.fixture(scope="module")
def recorded() -> Recorded:
    planted = winding()
    with tempfile.TemporaryDirectory() as folder:
        source = planted.write(Path(folder))
        listener = Listener(load_config(source), source)
        listener.take(FrameBatch.of(planted.messages))
    return listener.recorded()


def bent(radar: RadarTrack, share: float, ripple: float, rng: np.random.Generator) -> RadarTrack:
    """Some of its detections, with azimuths that are bent by `ripple` rad as a sensor bends them, always alike."""
    kept = rng.random(len(radar.range)) < share
    first = np.concatenate(([0], np.cumsum(np.bincount(radar.scan[kept], minlength=len(radar))))).astype(np.intp)
    azimuth = radar.azimuth[kept] + ripple * np.sin(5.0 * radar.azimuth[kept] + rng.uniform(0, 2 * math.pi))
    return replace(radar, first=first, range=radar.range[kept], azimuth=azimuth, range_rate=radar.range_rate[kept])


@pytest.mark.parametrize("seed", range(4))
def test_the_sigma_of_a_yaw_covers_bent_azimuths(recorded: Recorded, seed: int) -> None:
    rng = np.random.default_rng(seed)
    sparse = replace(recorded, radars=tuple(bent(radar, 0.35, math.radians(0.8), rng) for radar in recorded.radars))
    judgement = judge(sparse, {radar.name: "one" for radar in sparse.radars})
    assert judgement.errors is not None
    for one in judgement.errors.radars:
        assert abs(one.yaw.value) < 3 * one.yaw.sigma
        assert one.yaw.sigma < math.radians(1.0)
    assert not [finding for finding in judgement.findings if finding.code == "mount_yaw"]
