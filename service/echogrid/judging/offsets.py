"""Time offsets: which radars are of other times than the rest, and what all share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from echogrid.core.messages import Floats
from echogrid.judging.finding import Finding, Undecided, surely
from echogrid.judging.recorded import RadarTrack
from echogrid.judging.refining import Errors, Estimate

LIMIT, SYSTEMATIC = 0.03, 0.01  # s: from where on it is worth a word, and what sound sensors showed beyond the noise
KNOWN, CERTAIN = 0.02, 5.0  # s, one sigma: a larger one says nothing of what is not beyond so many of it
ODD = 9.0  # squared sigmas that a radar with an offset of its own must explain
PLAIN = 4.0  # squared sigmas by which the best choice of such radars must be better than another one
RESTS = "changes of Doppler over the drive"
MISSING = "needs_acceleration"


def time_offsets(radars: Sequence[RadarTrack], errors: Errors, doubtful: set[str]) -> tuple[list[Finding], list[Undecided]]:
    """Of radars that differ from the others, and of those that agree; `doubtful`: those whose range rates fit nothing."""
    rows = [n for n, radar in enumerate(radars) if radar.name not in doubtful]
    values = np.array([errors.radars[n].offset.value for n in rows])
    covariance = errors.offsets[np.ix_(rows, rows)] + SYSTEMATIC**2 * np.eye(len(rows))
    known = [k for k in range(len(rows)) if covariance[k, k] < max(KNOWN, abs(values[k]) / CERTAIN) ** 2]
    missing = []
    if len(known) < len(rows):
        missing.append(Undecided(MISSING, "time offsets: not all known: accelerate and brake a few times, and drive bends"))
    if not known:
        return [], missing
    names = [radars[rows[k]].name for k in known]
    values, covariance = values[known], covariance[np.ix_(known, known)]
    odd = _odd(values, covariance)
    if odd is None:
        sentence = f"time offsets: those of {', '.join(names)} differ, and whose is wrong is not known: accelerate and brake, drive bends"
        missing.append(Undecided(MISSING, sentence))
        covariance, odd = covariance + np.var(values) * np.ones_like(covariance), ()
    alike = [k for k in range(len(known)) if k not in odd]
    common, weights = _mean(values[alike], covariance[np.ix_(alike, alike)])
    whole = Estimate(common.value, math.hypot(common.sigma, SYSTEMATIC))  # what is alike in all does not show between them
    shared = whole.beyond(LIMIT)
    found = []
    for k in odd:
        among = covariance[k, alike] @ weights
        apart = Estimate(float(values[k]) - common.value, math.sqrt(max(covariance[k, k] + common.sigma**2 - 2 * float(among), 0.0)))
        if not apart.beyond(LIMIT):
            continue
        own = Estimate(float(values[k]), math.sqrt(covariance[k, k])) if shared and common.value < 0 else apart
        late = "late" if own.value < 0 else "early"
        sentence = f"radar {names[k]}: its scans come {abs(own.value) * 1e3:.0f} ms {late} (±{own.sigma * 1e3:.0f} ms), unlike the others"
        found.append(Finding("time_offset", sentence, -own.value * 1e3, "ms", surely(apart.value, apart.sigma, LIMIT), RESTS, (names[k],)))
    if shared:
        rest = [names[k] for k in alike]
        later = "ego motion comes" if common.value > 0 else f"the scans of {', '.join(rest)} come"
        sentence = f"{later} {abs(whole.value) * 1e3:.0f} ms late (±{whole.sigma * 1e3:.0f} ms)"
        who, subject = ((), "motion") if common.value > 0 else (tuple(rest), "")
        sure = surely(whole.value, whole.sigma, LIMIT)
        found.append(Finding("time_offset", sentence, abs(common.value) * 1e3, "ms", sure, RESTS, who, subject))
    return found, missing


def _odd(values: Floats, covariance: Floats) -> tuple[int, ...] | None:
    """Which of the offsets (K,) are no common one: the fewest that explain them; None where other ones would do nearly as well.

    At most half of them: one cause that most share explains more than one for each.
    """
    every = range(len(values))
    tried = []
    for count in range(len(values) // 2 + 1):
        for odd in combinations(every, count):
            alike = [k for k in every if k not in odd]
            part = covariance[np.ix_(alike, alike)]
            left = values[alike] - _mean(values[alike], part)[0].value
            tried.append((float(left @ np.linalg.solve(part, left)) + ODD * count, odd))
    cost, best = min(tried)
    others = [one for one, odd in tried if not set(best) <= set(odd)]
    return None if others and min(others) - cost < PLAIN else best


def _mean(values: Floats, covariance: Floats) -> tuple[Estimate, Floats]:
    """The common value of (K,), and the weights (K,) that make it."""
    weights = np.linalg.solve(covariance, np.ones(len(values)))
    weights = weights / weights.sum()
    return Estimate(float(weights @ values), math.sqrt(float(weights @ covariance @ weights))), weights
