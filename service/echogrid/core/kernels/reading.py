"""The reference's loops that read a map out: layers to log-odds, log-odds to percent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.answers import LN2_HIGH, LN2_LOW, exponential
from echogrid.core.kernels.cells import Integers, Singles

LEAST, MOST = 1e-30, 1e30  # odds beyond which log-odds go no further
HALF_ROOT = np.float32(0.70710677)  # of 2: where a mantissa's octave begins
ODD = [np.float32(1 / n) for n in (11, 9, 7, 5, 3)]
TINY = np.finfo(np.float32).tiny


def read_out(
    row: int, column: int, places: Integers, parts: Sequence[Singles], gain: float, offset: float, rule: Singles, out: Singles
) -> None:
    """Log-odds (H, W) of the cells from (row, column) on, out of parts of a LookMap, layers (5, …, …) each, whose first cells are at places
    (T, 2): by the rule of docs/fusion.md, whose numbers (16,) `core.map.read_out` names; 0 where all layers are 0 or no part is, and only
    there. `gain` and `offset` calibrate the mean of what the network said.

    Worked out in odds, which takes fewer logarithms.
    """
    out[:] = 0
    height, width = out.shape
    for (top, left), layers in zip((places - (row, column)).tolist(), parts, strict=True):
        above, aside = max(-top, 0), max(-left, 0)  # of the part, outside the window
        found = log_odds_of(layers[:, above : max(height - top, above), aside : max(width - left, aside)], gain, offset, rule)
        out[max(top, 0) :, max(left, 0) :][: found.shape[0], : found.shape[1]] = found


def log_odds_of(layers: Singles, gain: float, offset: float, rule: Singles) -> Singles:
    """Of layers (5, H, W): (H, W)."""
    learned, prior, surest, hit, near, passed, none, doubt, doubted, slope, steep, alone, enough, surer, least, calmer = rule
    total, weight, hits, beside, passes = layers
    known = (total != 0) | (weight != 0) | (hits != 0) | (beside != 0) | (passes != 0)
    divisor = np.where(weight > np.float32(1e-6), weight, np.float32(1e-6))
    said = np.where(weight > 0, np.float32(gain) * (total / divisor) + np.float32(offset), np.float32(0))
    passing = passed * (passes * np.sqrt(np.sqrt(passes))) + none
    weighed = exponential(within(learned * said, -prior, surest)) / passing
    aside = weighed * (near * beside + none)
    bent = doubt + slope * (logarithm(aside) - doubt)
    aside = np.where(aside > doubted, exponential(bent), aside)
    inside = weighed * (hit * hits + none)
    lone = exponential(within(steep * said + alone, -60, enough)) / passing
    lone = np.where(said == 0, np.float32(0), lone)
    log_odds = logarithm(aside * aside + inside * inside + lone * lone) * np.float32(0.5)
    above = log_odds - doubt
    surely = doubt + surer * above
    share = above / doubt  # -1 … 0
    between = least + least * (share * share * share)
    log_odds = np.where(above < 0, surely, np.where(log_odds < 0, between, calmer * log_odds))
    return np.where(known, np.where(log_odds == 0, TINY, log_odds), np.float32(0))


def percent(log_odds: Singles, out: NDArray[np.int8]) -> None:
    """(H, W) log-odds -> percent, rounded; -1 where they are 0. The opposite's percent is what is left of 100."""
    size = np.where(np.abs(log_odds) < np.float32(60), np.abs(log_odds), np.float32(60))
    surely = np.float32(100) / (1 + exponential(-size)) + np.float32(0.5)
    whole = surely.astype(np.int32)
    out[:] = np.where(log_odds == 0, -1, np.where(log_odds < 0, 100 - whole, whole))


def logarithm(x: Singles) -> Singles:
    """Natural logarithm of x within LEAST … MOST, to 3e-7 of it or of 1: by sums, products and quotients: the same everywhere."""
    bits = within(x, LEAST, MOST).view(np.int32) - HALF_ROOT.view(np.int32)
    exponent = bits >> 23  # of 2, with a mantissa between HALF_ROOT and its double
    mantissa = ((bits & 0x7FFFFF) + HALF_ROOT.view(np.int32)).view(np.float32)
    ratio = (mantissa - 1) / (mantissa + 1)  # ln m = 2 (r + r³/3 + r⁵/5 + …)
    square = ratio * ratio
    series = np.full_like(x, ODD[0])
    for factor in ODD[1:]:
        series = series * square + factor
    k = exponent.astype(np.float32)
    found: Singles = (2 * ratio * square * series - k * LN2_LOW) + 2 * ratio + k * LN2_HIGH
    return found


def within(x: Singles, least: float, most: float) -> Singles:
    """Clipped; what is no number becomes `least`."""
    above = np.where(x > np.float32(least), x, np.float32(least))
    return np.where(above < np.float32(most), above, np.float32(most))


def differing(before: NDArray[np.int8], after: NDArray[np.int8], out: Integers) -> None:
    """The smallest rectangle of the arrays (H, W) outside which they are equal: out (4,) is its first row and column, height and width;
    all 0 where they are equal everywhere."""
    differs = before != after
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    out[:] = (rows[0], columns[0], rows[-1] - rows[0] + 1, columns[-1] - columns[0] + 1) if len(rows) else 0
