"""What is left of scans: the share that was drawn, the same for the same seed, and nothing but less."""

from __future__ import annotations

import msgspec
import numpy as np
from tests.support.recordings import random_detections, scan_of

from echogrid.core.messages import RadarScan
from echogrid_training.sensors.disturbance import LEAST, LOST, NO_RCS, SPELL_NS, WHOLE, Disturbance

PER_DETECTION = ("range", "azimuth", "range_rate", "rcs")
SENSORS = ("front_left", "front_right", "rear_left", "rear_right")


def scan(sensor: str = "front_left", spell: int = 0, number: int = 0, count: int = 200) -> RadarScan:
    stamp_ns = spell * SPELL_NS + number * 50_000_000
    return scan_of(sensor, stamp_ns, random_detections(np.random.default_rng(number), count))


def share(left: RadarScan | None) -> float:
    return 0.0 if left is None else len(left) / 200


def test_the_same_seed_does_the_same_to_the_same_scan() -> None:
    """In whatever order scans come, and another seed does something else."""
    scans = [scan(sensor, spell, number) for sensor in SENSORS for spell in range(5) for number in range(3)]
    there = [Disturbance(3)(one) for one in scans]
    back = [Disturbance(3)(one) for one in reversed(scans)][::-1]
    other = [Disturbance(4)(one) for one in scans]
    for one, again in zip(there, back, strict=True):
        assert (one is None) == (again is None)
        if one is not None and again is not None:
            assert all(getattr(one, key).tobytes() == getattr(again, key).tobytes() for key in PER_DETECTION)
    assert [share(one) for one in there] != [share(one) for one in other]


def test_what_is_left_is_part_of_the_scan_and_all_else_stays() -> None:
    for spell in range(40):
        whole = scan(spell=spell)
        left = Disturbance(1)(whole)
        if left is None:
            continue
        rows = {tuple(row) for row in np.stack([getattr(whole, key) for key in PER_DETECTION[:3]], axis=1).tolist()}
        kept = [tuple(row) for row in np.stack([getattr(left, key) for key in PER_DETECTION[:3]], axis=1).tolist()]
        assert len(set(kept)) == len(kept)
        assert set(kept) <= rows
        assert np.isnan(left.rcs).all() or set(left.rcs.tolist()) <= set(whole.rcs.tolist())
        for field in msgspec.structs.fields(RadarScan):
            if field.name not in PER_DETECTION:
                assert getattr(left, field.name) == getattr(whole, field.name)


def test_within_a_spell_the_share_stays_and_from_spell_to_spell_it_covers_the_range() -> None:
    """Half of the spells whole, the others anything from a quarter up: as counted, within three sigmas of the binomial."""
    shares = []
    for spell in range(300):
        kept = [
            share(left) for left in (Disturbance(2)(scan(sensor, spell, n)) for sensor in SENSORS for n in range(2)) if left is not None
        ]
        if kept:
            assert np.ptp(kept) < 6 * np.sqrt(0.25 / 200)
            shares.append(np.mean(kept))
    whole = np.mean(np.array(shares) == 1.0)
    assert abs(whole - WHOLE) < 3 * np.sqrt(0.25 / len(shares))
    thinned = np.sort([one for one in shares if one < 1.0])
    assert thinned[0] > LEAST - 0.05
    assert thinned[0] < LEAST + 0.1
    assert abs(np.mean(thinned) - (1 + LEAST) / 2) < 0.06


def test_some_radars_are_silent_for_a_spell_and_some_spells_have_no_cross_sections() -> None:
    """A radar is silent on its own account; the kind of sensor is the same all round the car."""
    silent, mute = [], []
    for spell in range(300):
        left = {sensor: [Disturbance(5)(scan(sensor, spell, n, count=8)) for n in range(3)] for sensor in SENSORS}
        for some in left.values():
            assert len({one is None for one in some}) == 1
            silent.append(some[0] is None)
        told = {bool(np.isnan(one.rcs).all()) for some in left.values() for one in some if one is not None and len(one)}
        assert len(told) <= 1
        mute += told
    assert abs(np.mean(silent) - LOST) < 3 * np.sqrt(LOST * (1 - LOST) / len(silent))
    assert abs(np.mean(mute) - NO_RCS) < 3 * np.sqrt(NO_RCS * (1 - NO_RCS) / len(mute))
    by_sensor = np.array(silent).reshape(-1, 4)
    assert 0 < by_sensor.any(axis=1).sum() > by_sensor.all(axis=1).sum()


def test_an_empty_scan_stays_one() -> None:
    left = [Disturbance(1)(scan(spell=spell, count=0)) for spell in range(20)]
    assert {len(one) for one in left if one is not None} == {0}
