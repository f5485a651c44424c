"""Which scans go into one map update: none waits for a frame behind the last one, whoever is lost, and however the radars' times drift."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from echogrid.core.messages import RadarScan
from echogrid.core.radar.gathering import Gathering

MS = 1_000_000
CYCLE, OLD = 50 * MS, 200 * MS
NAMES = ("a", "b", "c", "d")
Scans = list[tuple[int, str]]  # ns, radar


def scan(sensor: str, at_ns: int, missed: int = 0) -> RadarScan:
    return RadarScan(sensor, at_ns, at_ns, *np.zeros((4, 1)), missed=missed)


def times(phases: Iterable[float], period: float, until: float = 3000.0) -> Scans:
    """Of the radars, by their phases in ms."""
    found = [
        (round((phase + n * period) * MS), name) for name, phase in zip(NAMES, phases, strict=False) for n in range(int(until / period))
    ]
    return sorted(found)


def cycles(
    scans: Scans, frames_ms: float = 10.0, awaited: Iterable[str] = NAMES, gathering: Gathering | None = None
) -> list[tuple[int, Scans]]:
    """When each cycle ended and what was in it, with frames of ego motion as often as said: as the mapper does it."""
    gathering, found, pending = gathering or Gathering(CYCLE, OLD), [], list[tuple[int, str]]()
    ticks = [(round(n * frames_ms * MS), "") for n in range(int((scans[-1][0] / MS + 150) / frames_ms) + 2)]
    for at_ns, sensor in sorted([*scans, *ticks]):
        for news in (False, True) if sensor else (False,):
            if news:
                gathering.hear(scan(sensor, at_ns))
                pending.append((at_ns, sensor))
            ask_ns = None if gathering.begin_ns is None else gathering.ask_ns
            if ask_ns is None or gathering.is_whole(at_ns, awaited):
                assert sensor or ask_ns is None or at_ns >= ask_ns, "a frame ended the cycle that another bus's filter may keep back"
                gathering.end(at_ns, empty=not pending)
                found.append((at_ns, pending))
                pending = []
    return [one for one in found if one[1]]


def settled(found: list[tuple[int, Scans]]) -> list[tuple[int, Scans]]:
    """After the periods are known and before the scans end."""
    return found[12:-6]


@pytest.mark.parametrize("period", [49.0, 49.9, 50.0, 50.1, 51.0])
@pytest.mark.parametrize("phases", [(0.0, 1.0, 2.0, 3.0), (3.0, 15.5, 28.0, 40.5), (0.5, 0.6, 30.0, 31.0)])
def test_a_cycle_ends_with_the_last_scan_of_all_radars(phases: tuple[float, ...], period: float) -> None:
    """Whatever their phases are, and though their period is not quite the cycle."""
    found = settled(cycles(times(phases, period)))
    assert len(found) > 35
    assert all(sorted(name for _, name in scans) == list(NAMES) for _, scans in found)
    assert all(scans[-1][0] == end_ns for end_ns, scans in found)


def test_after_a_restart_it_is_as_new() -> None:
    """Times that follow may be earlier: a clock that was set back begins one new map, not one after the other."""
    scans = times((0.0, 1.0, 2.0, 3.0), 50.0, 400.0)
    restarted = Gathering(CYCLE, OLD)
    cycles([(at_ns + 100_000 * MS, name) for at_ns, name in scans], 1000.0, gathering=restarted)
    restarted.restart()
    assert vars(restarted) == vars(Gathering(CYCLE, OLD))
    assert cycles(scans, gathering=restarted) == cycles(scans)


def test_radars_that_fire_together_are_kept_together() -> None:
    """Also after a start amid their scans, and after one came late: the oldest scan of a cycle is then as new as can be."""
    late = [
        (at_ns + (9 * MS if name == "d" and 1000 * MS < at_ns < 1040 * MS else 0), name)
        for at_ns, name in times((0.0, 1.0, 2.0, 3.0), 50.0)
    ]
    found = settled(cycles(sorted(late)))
    spans = [end_ns - scans[0][0] for end_ns, scans in found]
    assert sum(span > 3 * MS for span in spans) <= 4
    assert len(found) > 35


def test_a_lost_radar_delays_a_cycle_by_a_tenth() -> None:
    scans = [(at_ns, name) for at_ns, name in times((3.0, 15.5, 28.0, 40.5), 50.0) if name != "d" or not 1000 * MS < at_ns < 2000 * MS]
    ends = [end_ns for end_ns, _ in settled(cycles(scans, frames_ms=1.0))]
    steps = np.diff(ends) / MS
    assert steps.max() <= 56.0
    assert (np.abs(steps - 50.0) > 13.0).sum() == 0
    assert (steps > 54.0).sum() <= 2
    found = [one for one in cycles(scans, frames_ms=1.0) if 1300 * MS < one[0] < 1950 * MS]
    assert all(scans[-1][0] == end_ns and sorted(name for _, name in scans) == ["a", "b", "c"] for end_ns, scans in found)


def test_a_radar_that_is_not_trusted_is_not_waited_for() -> None:
    found = settled(cycles(times((3.0, 15.5, 28.0, 40.5), 50.0), awaited=("a", "b")))
    assert all(scans[-1] in ((end_ns, "a"), (end_ns, "b")) for end_ns, scans in found)


def test_twice_as_many_scans_as_cycles_make_no_more_cycles() -> None:
    """`cycle_ms` is then what says how often."""
    ends = [end_ns for end_ns, _ in settled(cycles(times((1.0, 9.0), 25.0)))]
    assert np.diff(ends).mean() / MS == pytest.approx(50.0, abs=1.0)


def test_after_an_empty_cycle_a_scan_does_not_wait() -> None:
    """Radars that are slower than the cycle."""
    found = settled(cycles(times((0.0,), 66.0), awaited=("a",)))
    assert all(scans == [(end_ns, "a")] for end_ns, scans in found)


@pytest.mark.parametrize(("missed", "is_due"), [(0, False), (1, True)])
def test_a_missed_scan_makes_no_period_longer(missed: int, is_due: bool) -> None:
    """Scans 28 ms apart, with one missed between them: the next one comes at 42 ms, not at 56."""
    gathering = Gathering(CYCLE, OLD)
    gathering.hear(scan("a", 0))
    gathering.hear(scan("a", 28 * MS, missed))
    assert gathering.is_whole(46 * MS, ("a",)) != is_due


def test_a_radar_of_one_scan_is_waited_for_until_that_is_too_old() -> None:
    gathering, begin = Gathering(CYCLE, OLD), 1000
    gathering.hear(scan("b", begin * MS))
    for later, is_whole in ((50, False), (100, False), (150, True)):
        gathering.end((begin + later + 6) * MS, empty=False)
        assert gathering.begin_ns == (begin + later) * MS
        gathering.hear(scan("a", (begin + later + 49) * MS))
        assert gathering.is_whole((begin + later + 50) * MS, ("b",)) == is_whole


def test_when_to_ask() -> None:
    """At a cycle's half, when all may have come that come once; where something is due, a tenth before its time, and a tenth behind it."""
    gathering = Gathering(CYCLE, OLD)
    gathering.hear(scan("a", 0))
    assert gathering.ask_ns == 25 * MS
    assert not gathering.is_whole(25 * MS, ("a",))
    assert gathering.ask_ns == 45 * MS
    assert not gathering.is_whole(45 * MS, ("a",))
    assert gathering.ask_ns == gathering.latest_ns == 55 * MS


@pytest.mark.parametrize("awaited", [NAMES, ("b", "c")])
def test_the_end_is_expected_with_the_last_scan_that_is_awaited(awaited: tuple[str, ...]) -> None:
    """From the begin of each cycle on, and a little before: a radar may be early. How early, it learns."""
    gathering, early, said = Gathering(CYCLE, OLD), list[float](), list[int]()
    assert gathering.expected_ns == 0
    for at_ns, name in times((3.0, 15.5, 28.0, 40.5), 50.0, until=20_000.0):
        gathering.hear(scan(name, at_ns))
        if gathering.is_whole(at_ns, awaited):
            early.append(max(abs(at_ns - one) for one in said) / MS if said else 0.0)
            gathering.end(at_ns, empty=False)
            said = []
        said.append(gathering.expected_ns)
    assert len(early) > 390
    assert max(early[10:]) < 50 / 8 + 0.1
    assert max(early[-100:]) < 0.5


def test_the_end_of_a_cycle_of_radars_that_come_as_they_like_is_expected_by_its_time() -> None:
    """For no scan alone can end it before its last tenth."""
    gathering = Gathering(CYCLE, OLD)
    for at_ns, name in times((3.0, 15.5), 77.0, until=1000.0):
        gathering.hear(scan(name, at_ns))
        if gathering.is_whole(at_ns, NAMES):
            gathering.end(at_ns, empty=False)
            assert gathering.begin_ns is not None
            assert gathering.begin_ns + CYCLE - CYCLE // 10 <= gathering.expected_ns <= gathering.latest_ns


@settings(max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 1000), st.sampled_from(NAMES)), min_size=1, max_size=80), st.sampled_from([1.0, 3.0, 7.0, 25.0]))
def test_which_scans_are_together_does_not_depend_on_other_frames(sent: list[tuple[int, str]], frames_ms: float) -> None:
    """A recording has those that a bus's filter keeps from the service."""
    scans = sorted((at * MS, name) for at, name in sent)
    many, few = ([inside for _, inside in cycles(scans, every)] for every in (frames_ms, 4 * frames_ms))
    assert many == few


@settings(max_examples=40)
@given(
    st.lists(st.tuples(st.integers(0, 1000), st.sampled_from(NAMES)), min_size=1, max_size=80),
    st.sampled_from([1.0, 7.0, 20.0]),
)
def test_every_scan_is_in_one_cycle_and_none_lasts_long(sent: list[tuple[int, str]], frames_ms: float) -> None:
    scans = sorted((at * MS, name) for at, name in sent)
    found = cycles(scans, frames_ms)
    assert sorted(one for _, inside in found for one in inside) == scans
    assert all(end_ns - inside[0][0] <= CYCLE + 2 * (CYCLE // 10) + frames_ms * MS for end_ns, inside in found)
    ends = [end_ns for end_ns, _ in found]
    least = CYCLE // 2 - CYCLE // 10  # after one that waited comes one that does not, which began earlier
    assert all(later - end >= least - frames_ms * MS for end, later in itertools.pairwise(ends))
