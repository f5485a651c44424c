"""Small errors, all estimated at once over the whole drive: mount yaws, time offsets, wheel scale, yaw-rate bias and scale.

Robust least squares over the range rates of standing things. Each error bends them in its own way: a yaw by the speed across the line of
sight, a time offset by acceleration, a yaw-rate bias by the lever arm. What the drive does not tell apart keeps a wide sigma: the priors
say how wide. Sigmas count seconds and sectors, not detections, as independent: what disturbs one disturbs its neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import STANDSTILL
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.judging.recorded import Flags, RadarTrack, Track
from echogrid.judging.weighing import MOVING

MOST = 40_000  # detections of a radar that are used
ROUNDS = 4
CUT = 3.0  # robust sigmas: what is farther off does not stand
FLOOR = 0.05  # m/s: no residual spread is smaller
BLOCK = 2.0  # s that count as one observation
SECTOR = math.radians(12.0)  # of the azimuths, that counts as one as well: sensors bend azimuths differently in each
FREE = 8  # parameters that bend one radar's range rates: as many observations are used up
YAW, OFFSET, RATE_BIAS, STRETCH = math.radians(20.0), 0.3, 0.15, 0.02  # prior sigmas of each radar: rad, s, m/s, share of the azimuths
PLACE = 0.3  # m, of its x and y
OWN = 6  # parameters of a radar
SCALE, BIAS, TURN_SCALE = 0.3, math.radians(2.0), 0.02  # of the car: share, rad/s, share
AXLE, SLIP = 0.3, 0.003  # of the car: m by which the rear axle lies elsewhere, s²/m of side slip
COMMON = 5  # parameters of the car
STANDING = 2.0  # s of standing still from which on the yaw rate's bias is read off directly
EDGE = 1.0  # s at both ends of a stop that do not count


@dataclass(frozen=True, slots=True)
class Estimate:
    """With one sigma."""

    value: float
    sigma: float

    def beyond(self, limit: float, sigmas: float = 2.0) -> bool:
        """Whether it is surely, by so many sigmas, farther from 0."""
        return abs(self.value) - sigmas * self.sigma > limit


@dataclass(frozen=True, slots=True)
class RadarErrors:
    """True yaw = the mount's + `yaw` (rad); the radar saw at t what ego motion said at t + `offset` (s); its range rates are `rate_bias`
    (m/s) too high; true place = the mount's + (`x`, `y`) (m). `spread` (m/s): robust sigma of what is left.
    """

    yaw: Estimate
    offset: Estimate
    rate_bias: Estimate
    x: Estimate
    y: Estimate
    spread: float


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """True speed = (1 + `scale`) x decoded; true yaw rate = (1 + `turn_scale`) x decoded - `bias` (rad/s).

    `standing`: the bias as it was read while the car stood; None where it did not stand long enough.
    """

    radars: tuple[RadarErrors, ...]
    scale: Estimate
    bias: Estimate
    turn_scale: Estimate
    standing: Estimate | None
    offsets: Floats  # (R, R) s², covariance of the radars' offsets


@dataclass(frozen=True, slots=True, eq=False)
class _Chosen:
    """The detections of one radar that are fitted, (N,) each."""

    mount: Mount
    time: Floats
    azimuth: Floats
    range_rate: Floats
    interval: Floats


def refine(radars: Sequence[RadarTrack], agrees: Sequence[Flags], speed: Track, yaw_rate: Track, turn_scale: float = TURN_SCALE) -> Errors:
    """`radars` and motion as the weighed hypothesis mends them; `agrees` (N,) which detections stand, by each scan itself.

    `turn_scale`: prior sigma of the yaw rate's scale.
    """
    chosen = [_choose(radar, stands, speed) for radar, stands in zip(radars, agrees, strict=True)]
    count = OWN * len(radars) + COMMON
    prior = np.array([YAW, OFFSET, RATE_BIAS, STRETCH, PLACE, PLACE] * len(radars) + [SCALE, BIAS, turn_scale, AXLE, SLIP]) ** -2.0
    at_rest = standing_bias(speed, yaw_rate)
    centre = np.zeros(count)
    if at_rest is not None:
        centre[-4], prior[-4] = at_rest.value, at_rest.sigma**-2.0
    found, spreads = centre.copy(), [3 * FLOOR] * len(radars)
    covariance = np.diag(1 / prior)
    for _ in range(ROUNDS):
        normal, right = np.diag(prior), prior * (centre - found)
        scores: dict[int, Floats] = {}
        by_sector = np.zeros((count, count))
        for n, one in enumerate(chosen):
            columns, left = _linearised(one, found[OWN * n : OWN * n + OWN], found[-COMMON:], speed, yaw_rate)
            if len(left) < 20:
                continue
            middle = np.median(left)
            spreads[n] = max(1.4826 * float(np.median(np.abs(left - middle))), FLOOR)
            inside = np.abs(left) < CUT * max(spreads[n], abs(middle))
            columns, left = columns[inside] / spreads[n], left[inside] / spreads[n]
            places = [*range(OWN * n, OWN * n + OWN), *range(count - COMMON, count)]
            normal[np.ix_(places, places)] += columns.T @ columns
            right[places] += columns.T @ left
            gradient = columns * left[:, None]
            _add_scores(scores, gradient, one.time[inside], places, count)
            by_sector[np.ix_(places, places)] += _sectors(gradient, one.azimuth[inside])
        inverse = np.linalg.inv(normal)
        found = found + inverse @ right
        summed = np.array(list(scores.values())) if scores else np.zeros((1, count))
        blocks = len(summed) * len(summed) / max(len(summed) - FREE, 1)
        covariance = inverse @ (np.diag(prior) + summed.T @ summed * blocks / len(summed) + by_sector) @ inverse
    sigma = np.sqrt(np.diag(covariance))
    each = [Estimate(float(value), float(one)) for value, one in zip(found, sigma, strict=True)]
    errors = []
    for n, spread in enumerate(spreads):
        yaw, offset, rate_bias, _, x, y = each[OWN * n : OWN * n + OWN]
        errors.append(RadarErrors(yaw, offset, rate_bias, x, y, spread))
    scale, bias, turning = each[-COMMON : -COMMON + 3]
    own = np.arange(len(radars)) * OWN + 1
    return Errors(tuple(errors), scale, bias, turning, at_rest, covariance[np.ix_(own, own)])


def standing_bias(speed: Track, yaw_rate: Track) -> Estimate | None:
    """The mean yaw rate (rad/s) while the wheels stood, without the first and the last second of each stop."""
    if not len(speed) or not len(yaw_rate):
        return None
    moves = np.concatenate(([-np.inf], speed.time[np.abs(speed.value) >= STANDSTILL], [np.inf]))
    after = np.searchsorted(moves, yaw_rate.time, side="right")
    since, until = yaw_rate.time - moves[after - 1], moves[np.minimum(after, len(moves) - 1)] - yaw_rate.time
    still = (since > EDGE) & (until > EDGE) & (yaw_rate.time >= speed.time[0]) & (yaw_rate.time <= speed.time[-1])
    rates = yaw_rate.value[still]
    steps = np.diff(yaw_rate.time)
    if not len(steps) or len(rates) * float(np.median(steps)) < STANDING:
        return None
    return Estimate(float(rates.mean()), max(float(rates.std()) / math.sqrt(len(rates)), math.radians(0.02)))


def _choose(radar: RadarTrack, stands: Flags, speed: Track) -> _Chosen:
    scan = radar.scan
    kept = np.flatnonzero(stands & (np.abs(speed.at(radar.time)) > MOVING)[scan])
    if len(kept) > MOST:
        kept = kept[:: math.ceil(len(kept) / MOST)]
    return _Chosen(radar.mount, radar.time[scan[kept]], radar.azimuth[kept], radar.range_rate[kept], radar.ambiguity[scan[kept]])


def _linearised(one: _Chosen, own: Floats, common: Floats, speed: Track, yaw_rate: Track) -> tuple[Floats, Floats]:
    """(N, OWN + COMMON) derivatives of the range rates, and what is left (N,) of them.

    By yaw, offset, rate bias, stretch, x and y of the radar, then scale, bias and scale of the yaw rate, place of the axle and slip.
    """
    yaw, offset, rate_bias, stretch, x, y = own
    scale, bias, turn_scale, axle, slip = common
    place = one.mount.base_from_sensor
    time = one.time + offset
    said, turned = speed.at(time), yaw_rate.at(time)
    v, w = (1 + scale) * said, (1 + turn_scale) * turned - bias
    bearing = (1 + stretch) * one.azimuth + place.yaw + yaw
    cos, sin = np.cos(bearing), np.sin(bearing)
    lever = (place.y + y) * cos - (place.x + x) * sin  # derivative by the yaw rate
    sideways = w * (axle - slip * v**2)  # of the rear axle, whose tyres slip in a bend
    predicted = -v * cos - sideways * sin + w * lever + rate_bias
    left = one.range_rate - predicted
    known = np.where(one.interval > 0, one.interval, 1.0)
    left = np.where(one.interval > 0, left - known * np.round(left / known), left)
    by_bearing = v * sin - sideways * cos - w * (place.y * sin + place.x * cos)
    columns = np.stack(
        (
            by_bearing,
            -speed.rate(time) * cos + yaw_rate.rate(time) * lever,
            np.ones_like(left),
            by_bearing * one.azimuth,
            -w * sin,
            w * cos,
            -said * cos,
            -lever,
            turned * lever,
            -w * sin,
            w * v**2 * sin,
        ),
        axis=1,
    )
    return columns, left


def _add_scores(scores: dict[int, Floats], gradient: Floats, time: Floats, places: list[int], count: int) -> None:
    """Sums gradients (N, OWN + COMMON) by blocks of time."""
    block = np.floor(time / BLOCK).astype(np.intp)
    for number in np.unique(block):
        score = scores.setdefault(int(number), np.zeros(count))
        score[places] += gradient[block == number].sum(axis=0)


def _sectors(gradient: Floats, azimuth: Floats) -> Floats:
    """(P, P) by how much the sums of gradients (N, P) vary from sector to sector: what bends azimuths there does so all the drive long."""
    _, sector = np.unique(np.floor(azimuth / SECTOR), return_inverse=True)
    sums = np.zeros((int(sector.max(initial=0)) + 1, gradient.shape[1]))
    np.add.at(sums, sector, gradient)
    varied: Floats = sums.T @ sums * len(sums) / max(len(sums) - OWN, 1)
    return varied


def turned(mount: Mount, yaw: float) -> Mount:
    """The mount at the same place with another yaw (rad)."""
    place = mount.base_from_sensor
    return replace(mount, base_from_sensor=SE2(place.x, place.y, yaw))
