"""A scan with some of its detections is the same scan in all else; and what a message leaves unsaid is no news."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from echogrid.core.health import Health, SensorHealth
from echogrid.core.messages import RadarScan, Speed, YawRate

PLACES = ("range", "azimuth", "range_rate", "rcs")


def scan(size: int) -> RadarScan:
    """Whatever can be told from its default is."""
    columns = np.random.default_rng(size).normal(size=(4, size))
    return RadarScan("front", 5, 7, *columns, ambiguity=21.5, blockage=0.25, lag=-0.5, missed=3)


@given(st.lists(st.booleans(), max_size=12))
def test_a_scan_with_some_of_its_detections_is_the_same_in_all_else(mask: list[bool]) -> None:
    whole = scan(len(mask))
    some = whole.chosen(np.array(mask, np.bool_))
    assert len(some) == sum(mask)
    for name in PLACES:
        assert getattr(some, name).tolist() == [value for value, kept in zip(getattr(whole, name), mask, strict=True) if kept]
    others = [name for name in RadarScan.__struct_fields__ if name not in PLACES]
    assert [getattr(some, name) for name in others] == [getattr(whole, name) for name in others]


def test_what_a_sender_does_not_say_is_no_news() -> None:
    """As from one that says: unambiguous, clear, in time, none missed; no jump in time, both wheels alike."""
    bare = RadarScan("front", 5, 7, *np.zeros((4, 2)))
    said = replace(bare, ambiguity=0.0, blockage=0.0, lag=0.0, missed=0)
    names = RadarScan.__struct_fields__[7:]
    assert [getattr(bare, name) for name in names] == [getattr(said, name) for name in names]
    assert Speed(5, 3.0) == Speed(5, 3.0, True, 0.0)
    assert YawRate(5, 3.0) == YawRate(5, 3.0, True)


def test_counters_begin_at_0() -> None:
    counted = asdict(Health(sensors={"front": SensorHealth()}))
    numbers = [*counted.pop("sensors")["front"].values(), *counted.pop("pose").values(), *counted.values()]
    assert len(numbers) == 9 + 6 + 12
    assert not any(numbers)
