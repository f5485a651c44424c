"""What standing things that are seen again, seconds later and from elsewhere, say about the gyro."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.error_model import BIAS, HEADING, SCALE, TURN_SCALE, YAW, X, Y
from echogrid.core.motion.odometry import STANDSTILL, EgoState
from echogrid.core.radar.sightings import LATEST_NS, Complex, Look, Pairs, Turned, look, pairs
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep

PERIOD_NS, BATCH = 200_000_000, 15  # of a look; looks that are compared at once
SLOWEST = 1.0  # m/s: of a slower car nothing is learned
MOST, LEAST = 40, 30  # detections of a look that are used; pairs that are compared
CHANCE = 0.05  # per m²: how densely things are seen that were not there before
REPEATED = 6.0  # sightings that are worth one: what disturbs one disturbs its neighbours
DISTORTED = math.radians(0.1)  # rad/s: what is off in all batches alike, so that they average no farther
GUESSES = np.linspace(-2.5, 2.5, 11)  # sigmas of the bias, from which the search begins
STEPS = 5
SHARPEST = 0.03  # of the variances that are expected: tracked objects scatter by so little
BY_CHANCE = 0.25  # share of the information: with less, most pairs are none (streets 0.3 to 0.8, chance below 0.2)
MOVES = (X, Y, HEADING, BIAS)
NS, TINY = 1e-9, 1e-9


class SeenAgain:
    """Remembers the looks of the last seconds, the scans of the running one, and how the car has turned."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Places begin anew."""
        self._looks: deque[Look] = deque()
        self._new = 0  # of them, not compared yet
        self._scans: list[tuple[Sweep, Turned]] = []
        self._since_ns: int | None = None
        self._before: EgoState | None = None
        self._turned = Turned(np.zeros(3), np.zeros(3, np.complex128))

    def add(self, sweep: Sweep, errors: ErrorFilter, noise: GateNoise) -> None:
        """One cycle's scans of trusted radars."""
        if errors.learns != "driving":
            return
        ego = sweep.newest
        self._go(ego, errors)
        if abs(ego.speed) >= SLOWEST:
            self._scans.append((sweep, self._turned))
        if self._since_ns is None:
            self._since_ns = ego.stamp_ns
        if ego.stamp_ns - self._since_ns < PERIOD_NS or not self._scans:
            return
        self._since_ns = ego.stamp_ns
        seen = look(self._scans, {name: n for n, name in enumerate(errors.radars)}, noise, MOST)
        self._scans = []
        if seen is None:
            return
        self._looks.append(seen)
        self._new += 1
        if self._new == BATCH:
            self._compare(errors)

    def _compare(self, errors: ErrorFilter) -> None:
        found = pairs(self._looks, self._new)
        self._new = 0
        told = compared(found, errors) if len(found.apart) >= LEAST else None
        if told is not None:
            errors.see(*told, MOVES)
        while self._looks and self._looks[0].stamp_ns < self._looks[-1].stamp_ns - LATEST_NS:
            self._looks.popleft()

    def _go(self, ego: EgoState, errors: ErrorFilter) -> None:
        """Goes on to a pose with what wheels and gyro said since the last one."""
        before, self._before = self._before, ego
        if before is None or abs(ego.speed) < STANDSTILL:
            return
        seconds = (ego.stamp_ns - before.stamp_ns) * NS
        a, b = before.odom_from_base, ego.odom_from_base
        bias = errors.bias * seconds
        sums = np.array((seconds, b.yaw - a.yaw + bias, bias))
        self._turned = Turned(self._turned.sums + sums, self._turned.moments + sums * complex(a.x + b.x, a.y + b.y) / 2)


def compared(found: Pairs, errors: ErrorFilter) -> tuple[Floats, Floats] | None:
    """Of at least one pair what it says of the bias: information (E, E) and vector (E,), as `ErrorFilter.see` takes them; None where that
    is nothing new, or the pairs seem to be pairs by chance.

    Each new sighting is one of the older ones near it, scattered about the same thing, or nothing known (a mixture, fitted by expectation
    and maximisation from the best of several guesses); how far they scatter is taken from what is left.
    """
    rows = np.array([BIAS, TURN_SCALE, SCALE, *(place + YAW for place in errors.places.values())])
    mean, prior = errors.mean[rows], errors.covariance[np.ix_(rows, rows)]
    mean[2] -= errors.scale  # the places have it already
    slope, left, density = _whitened(found, len(rows))
    expected = left + slope @ mean
    _, newer = np.unique(found.newer, return_inverse=True)
    density /= np.bincount(newer)[newer]
    along = prior[:, 0] / math.sqrt(prior[0, 0])  # all of them, where the bias is off by a sigma
    scores = [_shares(expected + slope @ along * guess, density, newer)[1] / REPEATED - guess**2 / 2 for guess in GUESSES.tolist()]
    off = along * GUESSES[int(np.argmax(scores))]
    for step in range(STEPS + 1):
        residual = expected + slope @ off
        shares, _ = _shares(residual, density, newer)
        spread = max(float(shares @ _squares(residual)) / (2.0 * float(shares.sum())), SHARPEST)
        weighted = slope * np.tile(shares / (REPEATED * spread), 2)[:, None]
        whole, gradient = weighted.T @ slope, -weighted.T @ residual
        if step < STEPS:
            off = np.linalg.solve(np.eye(len(rows)) + prior @ whole, prior @ (whole @ off + gradient))
    sigmas = np.sqrt(np.diag(prior))
    known = _sound(whole - _missing(slope, residual, shares, newer) / (REPEATED * spread), sigmas)
    if known[0, 0] < BY_CHANCE * whole[0, 0]:
        return None
    return _of_bias_alone(known, known @ off + gradient, sigmas, rows, len(errors.mean))


def _of_bias_alone(known: Floats, vector: Floats, sigmas: Floats, rows: NDArray[np.intp], count: int) -> tuple[Floats, Floats] | None:
    """Of what is known of all (K, K), (K,) the one combination that tells most of the first of them, with what is off in all batches alike;
    as information over `count` errors, at `rows`. `sigmas` (K,) of what was known before."""
    differs = 1.0 / DISTORTED**2 - 1.0 / float(sigmas[0]) ** 2
    if differs <= 0.0:
        return None
    others = np.concatenate(((TINY,), 1.0 / sigmas[1:] ** 2))
    first = np.linalg.solve(known + np.diag(others), np.eye(len(rows))[0])
    slope = known @ first
    variance = float(first @ slope) + float(slope[0]) ** 2 / differs
    information, told = np.zeros((count, count)), np.zeros(count)
    information[np.ix_(rows, rows)] = np.outer(slope, slope) / variance
    told[rows] = slope * (float(first @ vector) / variance)
    return information, told


def _squares(residual: Floats) -> Floats:
    """(P,) of residuals (2P,), x and then y."""
    half = len(residual) // 2
    squares: Floats = residual[:half] ** 2 + residual[half:] ** 2
    return squares


def _shares(residual: Floats, density: Floats, newer: NDArray[np.int64]) -> tuple[Floats, float]:
    """How surely each pair (P,) is one, and the logarithm of how likely all are. `density` where nothing is left, per m²; `newer` (P,)."""
    each = density * np.exp(_squares(residual) / -2.0)
    total = np.bincount(newer, each) + CHANCE
    return each / total[newer], float(np.log(total).sum())


def _missing(slope: Floats, residual: Floats, shares: Floats, newer: NDArray[np.int64]) -> Floats:
    """(K, K) of slopes (2P, K): the information that there would be besides if it was known which pairs are one (Louis). Of pairs by chance
    it is all of it."""
    half = len(shares)
    pull = slope * residual[:, None]
    pull = (pull[:half] + pull[half:]) * shares[:, None]
    each = np.stack([np.bincount(newer, one) for one in pull.T])
    missing: Floats = (pull / np.maximum(shares, 1e-12)[:, None]).T @ pull - each @ each.T
    return missing


def _sound(information: Floats, sigmas: Floats) -> Floats:
    """Without what is less than none, in units of `sigmas` (K,)."""
    values, axes = np.linalg.eigh(information * np.outer(sigmas, sigmas))
    axes /= sigmas[:, None]
    sound: Floats = axes * np.maximum(values, 0.0) @ axes.T
    return sound


def _whitened(found: Pairs, count: int) -> tuple[Floats, Floats, Floats]:
    """In sigmas, x and then y: derivatives (2P, count) by bias, turn scale, wheel scale and mounts' yaws; what the pairs are apart (2P,);
    and the density (P,) of the older sighting's place where it is expected, per m²."""
    xx, xy, yy = found.covariances
    first = np.sqrt(xx)
    mixed = xy / first
    second = np.sqrt(yy - mixed**2)

    def white(apart: Complex) -> Floats:
        return np.concatenate((apart.real / first, (apart.imag - mixed * apart.real / first) / second))

    slope = np.zeros((2 * len(xx), count))
    for n, column in enumerate((found.by_bias, found.by_turn, found.by_way)):
        slope[:, n] = white(column)
    yaw, radars = white(found.by_yaw), np.tile(found.radars, 2)
    for n in range(count - 3):
        slope[:, 3 + n] = np.where(radars == n, yaw, 0.0)
    return slope, white(found.apart), 1.0 / (2.0 * math.pi * first * second)
