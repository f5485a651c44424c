"""The thread that publishes asks for the state while the one that maps may be starting a new map: it is told what was, or what is."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from echogrid.core.health import PoseHealth, SensorHealth
from echogrid.core.motion.map_frame import MapFrame, _Told
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.trust.motion_watch import SampleWatch
from echogrid.core.trust.radar_watch import RadarWatch

NOW_NS = 10_000_000_000


def speed() -> SampleWatch:
    watch = SampleWatch("wheel speed", "m/s", 100.0, 15.0, 1.0, 0.35)
    watch.judge(1, 3.0)
    return watch


def jumped() -> SampleWatch:
    watch = speed()
    watch.judge(NOW_NS, 90.0)
    watch.last_ns, watch.implausible_ns = 1, NOW_NS
    return watch


def radar() -> RadarWatch:
    watch = RadarWatch(Mount(SE2(3.0, 0.5, 0.5), 1.0, 80.0), SensorHealth())
    watch.heard_ns, watch.scarce = NOW_NS, "only a few"
    return watch


def placed() -> MapFrame:
    frame = MapFrame(SE2(0.0, 0.0, 0.0), PoseHealth())
    frame._last = frame._other = _Told(NOW_NS, 0.0, 0.0, SE2(1.0, 2.0, 0.0))
    return frame


CASES: list[tuple[Callable[[], object], str, Callable[..., object]]] = [
    (speed, "last_ns", lambda one: one.silence(NOW_NS)),
    (jumped, "last_ns", lambda one: one.silence(NOW_NS)),
    (jumped, "implausible_ns", lambda one: one.silence(NOW_NS)),
    (jumped, "implausible_ns", lambda one: one.note(NOW_NS)),
    (radar, "heard_ns", lambda one: one.reasons(NOW_NS)),
    (radar, "heard_ns", lambda one: one.reasons(2 * NOW_NS)),
    (radar, "scarce", lambda one: one.reasons(NOW_NS)),
    (placed, "_last", lambda one: one.state(2 * NOW_NS)),
    (placed, "_other", lambda one: one.state(NOW_NS)),
    (placed, "_last", lambda one: one.map_from_odom),
]


@pytest.mark.parametrize(("make", "name", "ask"), CASES)
def test_what_is_told_is_of_before_or_of_after(make: Callable[[], object], name: str, ask: Callable[..., object]) -> None:
    """What a restart forgets is gone from each of the reads on, one after the other."""
    before, after = make(), make()
    setattr(after, name, None)
    for reads in range(5):
        one = make()
        value, read = getattr(one, name), itertools.count()
        forgets = property(lambda _, value=value, read=read, reads=reads: value if next(read) < reads else None)
        one.__class__ = type("Restarting", (type(one),), {name: forgets})
        assert ask(one) in (ask(before), ask(after))
