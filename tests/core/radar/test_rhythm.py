"""When a radar's next scan is expected: hardly ever too late, and not much too early."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid.core.radar.rhythm import Rhythm

MS = 1_000_000


def heard(times_ms: list[float]) -> list[float]:
    """By how much, in ms, each scan came after it was expected; those that nothing was known of are left out."""
    rhythm, after = Rhythm(), list[float]()
    for at in times_ms:
        if rhythm.soonest_ns:
            after.append(at - rhythm.soonest_ns / MS)
        rhythm.hear(round(at * MS))
    return after


def test_nothing_is_known_before_the_second_scan() -> None:
    rhythm = Rhythm()
    assert rhythm.soonest_ns == 0
    rhythm.hear(5 * MS)
    assert rhythm.soonest_ns == 0
    rhythm.hear(55 * MS)
    assert 98 * MS < rhythm.soonest_ns + 50 * MS // 8 < 106 * MS


@pytest.mark.parametrize("jitter", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("period", [33.3, 50.0, 50.1, 77.0])
def test_a_scan_is_seldom_sooner_and_never_much_later_than_expected(period: float, jitter: float) -> None:
    """Against the times that the scans would have without their jitter, which it does not know; a tenth of the scans are lost."""
    rng = np.random.default_rng(4)
    times = 1000.0 + period * np.arange(800) + rng.uniform(-jitter, jitter, 800)
    came = np.array(heard(times[rng.random(800) > 0.1].tolist()))[300:]
    came = came[came < period / 2]  # what came after a lost one is later by a period
    assert len(came) > 300
    assert (came < -0.01).mean() < 0.12
    assert came.min() >= -0.5 * jitter - 0.01
    assert came.max() < 3 * jitter + 0.5


def test_a_radar_that_starts_anew_is_followed_at_once() -> None:
    times = [*np.arange(0.0, 2000.0, 50.0), *np.arange(2020.0, 3000.0, 50.0)]
    assert max(map(abs, heard(times)[-10:])) < 50 / 8
    assert heard([*times, 3045.0])[-1] == pytest.approx(25.0, abs=50 / 8)  # what would have come at 3020 has not


def test_a_first_period_that_was_two_is_put_right() -> None:
    rhythm = Rhythm()
    for at in (0, 100, 150, 200):
        rhythm.hear(at * MS)
    assert 240 * MS <= rhythm.soonest_ns <= 250 * MS
