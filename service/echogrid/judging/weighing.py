"""Which mistakes explain a drive best: signs, units, swapped and turned mounts, weighed against each other.

Every hypothesis predicts the velocity of each radar from ego motion. Its cost is what it leaves unexplained in all radars together, plus a
price for each mistake that it assumes: one wrong sign of a signal that all share costs less than four wrong mounts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.judging.recorded import Track
from echogrid.judging.sensor_velocity import SensorVelocity

MOVING = 0.7  # m/s: a slower car's scans tell nothing
MOST = 400  # scans of a radar that are weighed
SIGMA, SIGMA_SHARE = 0.25, 0.03  # m/s, and of the velocity: what noise and small errors leave
GROSS = 9.0  # squared sigmas: more is a gross error, and counts as much
REPEATED = 8.0  # scans that are worth one, since neighbours repeat each other
PRICE = 12.0  # of one mistake, in squared sigmas
TURNED, ALONE, TWICE, MANY = 1.2, 1.6, 1.4, 3.0  # prices of a turned mount, a sign that one of equal radars has alone, two swaps, more
BY_WHEELS = 2.0  # price of a turn the other way round than the difference of the rear wheels has it, which may be mixed up themselves
CONTRADICTED = 3.0  # price of a scale of one radar's range rates against which its ranges speak
LEAST_RATIO = 1.12  # a scale nearer to 1 is nothing to be weighed here
UNIT_RATIOS = (3.6, 1 / 3.6, 100.0, 0.01)  # of units of speed
NEAR = 0.04  # share by which a ratio may be off that of a unit, and is taken for it
DEGREE = math.pi / 180
YAW_FACTORS = (1.0, -1.0, DEGREE, 1 / DEGREE, -DEGREE, -1 / DEGREE)
SIGNS = (1, -1)
AS_GIVEN, CLOCKWISE, IN_RADIANS, MIRRORED = "as given", "clockwise", "in radians", "y mirrored"  # what all configured mounts are

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Turned:
    """Of one radar: whose mount it has, the signs and scale that its values need, and by how much (rad) its yaw is off that mount's."""

    mount: int
    azimuth_sign: int = 1
    rate_sign: int = 1
    rate_scale: float = 1.0
    yaw: float = 0.0


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """True speed = `speed_factor` x decoded, true yaw rate = `yaw_factor` x decoded."""

    radars: tuple[Turned, ...]
    speed_factor: float = 1.0
    yaw_factor: float = 1.0
    mounted: str = AS_GIVEN


NO_MISTAKE = Hypothesis((Turned(0),))  # of one radar


@dataclass(frozen=True, slots=True)
class Weighed:
    """The best hypothesis, its cost, that of the best other one, that of no mistake at all, and each radar's unexplained share, 0 … 1."""

    best: Hypothesis
    cost: float
    next_best: float
    as_configured: float
    unexplained: tuple[float, ...]

    @property
    def confidence(self) -> float:
        """Of the best against the next best: 0.5 where they explain alike."""
        return 1.0 / (1.0 + math.exp(-min(self.next_best - self.cost, 40.0) / 4.0))


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A radar's scans that are weighed: its velocity (S,) m/s, x along boresight, and the car's speed and yaw rate at that time.

    `by_ranges`: whether its ranges change as its range rates say (1), as those by `ratio` of them say (-1), or neither surely (0).
    """

    velocity: Complex
    speed: Floats
    yaw_rate: Floats
    by_ranges: int = 0

    def __len__(self) -> int:
        return len(self.velocity)

    @property
    def worth(self) -> float:
        """In independent scans."""
        return len(self) / REPEATED

    @property
    def ratio(self) -> float:
        """How many times as fast as the wheels say the radar measures the car to be; 1 where that cannot be said."""
        turns = np.abs(self.yaw_rate) > 0.1 * np.abs(self.speed)
        straight = (np.abs(self.speed) > 0.05) & ~turns
        if np.count_nonzero(straight) < 10:
            straight = np.abs(self.speed) > 0.05
        if np.count_nonzero(straight) < 10:
            return 1.0
        return float(np.median(np.abs(self.velocity[straight]) / np.abs(self.speed[straight])))


def told_ratio(found: float) -> float:
    """A unit's ratio that is near; 1 where the ratio is near to that."""
    unit = next((ratio for ratio in UNIT_RATIOS if abs(found / ratio - 1) < NEAR), found)
    return unit if max(unit, 1 / unit) > LEAST_RATIO else 1.0


def sample(seen: SensorVelocity, speed: Track, yaw_rate: Track) -> Sample:
    """Of the scans in which the radar moved, evenly over the drive."""
    moving = np.flatnonzero(np.abs(seen.velocity) > MOVING)
    if len(moving) > MOST:
        moving = moving[np.linspace(0, len(moving) - 1, MOST).astype(np.intp)]
    time = seen.time[moving]
    return Sample(seen.velocity[moving], speed.at(time), yaw_rate.at(time))


def weigh(samples: Sequence[Sample], mounts: Sequence[Mount], profiles: Sequence[str], wheels: int = 0) -> Weighed:
    """All hypotheses over all radars, at least one; radars with an equal entry of `profiles` share its signs and units.

    `wheels`: whether the rear wheels' difference goes with the yaw rate as decoded (1) or against it (-1), or says nothing (0).
    """
    count = len(samples)
    measured = [one.ratio for one in samples]
    middle = float(np.median([ratio for ratio, one in zip(measured, samples, strict=True) if len(one)] or [1.0]))
    if all(abs(math.log(ratio / middle)) < math.log(LEAST_RATIO) for ratio, one in zip(measured, samples, strict=True) if len(one)):
        common = told_ratio(middle)
        ratios = [common] * count
    else:
        common, ratios = 1.0, [told_ratio(ratio) for ratio in measured]  # the wheels are not what is wrong
    groups = [[n for n in range(count) if profiles[n] == profile] for profile in dict.fromkeys(profiles)]
    tried: list[tuple[float, Hypothesis]] = []
    as_configured = math.inf
    for speed_factor, scaled, yaw_factor in product(dict.fromkeys((1.0, -1.0, common, -common)), (False, True), YAW_FACTORS):
        scales = [1.0 / ratio for ratio in ratios] if scaled else [1.0] * count
        if scaled and (abs(speed_factor) != 1.0 or all(scale == 1.0 for scale in scales)):
            continue
        shared = float(speed_factor < 0) + (abs(speed_factor) != 1) + (yaw_factor < 0) + (abs(yaw_factor) != 1)
        shared += sum(any(scales[n] != 1.0 for n in group) for group in groups)
        shared += BY_WHEELS * (wheels * speed_factor * yaw_factor < 0)
        against = -1 if not scaled else 1
        shared += CONTRADICTED * sum(one.by_ranges == against for one, ratio in zip(samples, ratios, strict=True) if ratio != 1.0)
        for mounted in (AS_GIVEN, CLOCKWISE, IN_RADIANS, MIRRORED):
            places = [placed(mount, mounted) for mount in mounts]
            costs = [_costs(one, places, scale, speed_factor, yaw_factor) for one, scale in zip(samples, scales, strict=True)]
            if (speed_factor, yaw_factor, mounted, scaled) == (1.0, 1.0, AS_GIVEN, False):
                as_configured = sum(float(costs[n][0][0, 0, n]) for n in range(count))
            for order, price in _orders(count) if mounted == AS_GIVEN else [(tuple(range(count)), 1.0)]:
                total, turned = _cheapest(costs, order, groups, scales)
                tried.append((total + PRICE * (price + shared), Hypothesis(turned, speed_factor, yaw_factor, mounted)))
    tried.sort(key=lambda one: one[0])
    cost, best = tried[0]
    left = tuple(unexplained(samples[n], best, best.radars[n], mounts) for n in range(count))
    return Weighed(best, cost, tried[1][0], as_configured, left)


def predicted(mount: Mount, yaw: float, speed: Floats, yaw_rate: Floats) -> Complex:
    """(S,) velocity of a radar at the mount's place, in its own frame if its yaw is `yaw`: what standing things would show it."""
    place = mount.base_from_sensor
    moved: Complex = ((speed - yaw_rate * place.y) + 1j * yaw_rate * place.x) * np.exp(-1j * yaw)
    return moved


def mended(one: Sample, turned: Turned) -> Complex:
    """(S,) the velocity that the radar would have measured with the signs and scale of `turned`."""
    velocity: Complex = one.velocity if turned.azimuth_sign > 0 else one.velocity.conj()
    return velocity * turned.rate_sign * turned.rate_scale


def placed(mount: Mount, mounted: str) -> Mount:
    """The mount as it is if all were configured with this mistake."""
    place = mount.base_from_sensor
    yaw = {CLOCKWISE: -place.yaw, IN_RADIANS: place.yaw / DEGREE}.get(mounted, place.yaw)
    return replace(mount, base_from_sensor=SE2(place.x, -place.y if mounted == MIRRORED else place.y, yaw))


def _orders(count: int) -> Iterator[tuple[tuple[int, ...], float]]:
    """Whose mount each radar may have, with the price of it: all orders of up to four radars, else single swaps."""
    every = permutations(range(count)) if count <= 4 else _single_swaps(count)
    for order in every:
        moved = [n for n in range(count) if order[n] != n]
        swaps = all(order[order[n]] == n for n in moved)
        yield order, {0: 0.0, 2: 1.0}.get(len(moved), TWICE if swaps else MANY)


def _single_swaps(count: int) -> Iterator[tuple[int, ...]]:
    yield tuple(range(count))
    for one in range(count):
        for other in range(one):
            order = list(range(count))
            order[one], order[other] = other, one
            yield tuple(order)


def _costs(one: Sample, mounts: Sequence[Mount], scale: float, speed_factor: float, yaw_factor: float) -> tuple[Floats, Floats, Floats]:
    """Costs (2, 2, M) by signs of azimuth and range rate and by mount: with the mount's yaw, with the best yaw, and that yaw's offset."""
    speed, yaw_rate = speed_factor * one.speed, yaw_factor * one.yaw_rate
    wanted = np.stack([predicted(mount, mount.base_from_sensor.yaw, speed, yaw_rate) for mount in mounts])  # (M, S)
    signed = [[mended(one, Turned(0, a, g, scale)) for g in SIGNS] for a in SIGNS]
    measured = np.array(signed)[:, :, None]  # (2, 2, 1, S)
    variance = (SIGMA * min(scale, 1.0) + SIGMA_SHARE * np.abs(one.velocity) * scale) ** 2  # smaller values scatter less
    agreeing = measured * wanted.conj()
    phase = np.angle((agreeing / (np.abs(agreeing) + 1e-9)).sum(axis=-1))  # of the radar's, less the mount's
    for _ in range(2):
        left = np.angle(agreeing * np.exp(-1j * phase[..., None]))
        phase = phase + np.median(left, axis=-1) if left.shape[-1] else phase
    plain = _robust(measured - wanted, variance)
    turned = _robust(measured - wanted * np.exp(1j * phase[..., None]), variance)
    return one.worth * plain, one.worth * turned, -phase


def _robust(left: Complex, variance: Floats) -> Floats:
    """Mean squared sigmas over the last axis, none more than GROSS."""
    if not left.shape[-1]:
        return np.zeros(left.shape[:-1])
    mean: Floats = np.minimum(np.abs(left) ** 2 / variance, GROSS).mean(axis=-1)
    return mean


def _cheapest(
    costs: Sequence[tuple[Floats, Floats, Floats]], order: tuple[int, ...], groups: Sequence[Sequence[int]], scales: Sequence[float]
) -> tuple[float, tuple[Turned, ...]]:
    """The signs of each profile, and the turns of each radar, that cost least with this order of mounts."""
    total = 0.0
    chosen: dict[int, Turned] = {}
    for group in groups:
        best: tuple[float, list[tuple[int, Turned]]] = (math.inf, [])
        for a, g in product((0, 1), (0, 1)):
            price, turned = PRICE * (a + g), []
            for n in group:
                plain, free, yaw = costs[n]
                mount = order[n]
                options = []
                for own in (a, 1 - a):
                    alone = PRICE * ALONE * (own != a) if len(group) > 1 else (0.0 if own == a else math.inf)
                    options.append((float(plain[own, g, mount]) + alone, own, 0.0))
                    options.append((float(free[own, g, mount]) + alone + PRICE * TURNED, own, float(yaw[own, g, mount])))
                each, own, off = min(options)
                price += each
                turned.append((n, Turned(mount, SIGNS[own], SIGNS[g], scales[n], off)))
            best = min(best, (price, turned), key=lambda one: one[0])
        total += best[0]
        chosen.update(best[1])
    return total, tuple(chosen[n] for n in range(len(order)))


def unexplained(one: Sample, best: Hypothesis, turned: Turned, mounts: Sequence[Mount]) -> float:
    """Share of a radar's scans that a hypothesis leaves."""
    if not len(one):
        return 0.0
    mount = placed(mounts[turned.mount], best.mounted)
    yaw = mount.base_from_sensor.yaw + turned.yaw
    wanted = predicted(mount, yaw, best.speed_factor * one.speed, best.yaw_factor * one.yaw_rate)
    variance = (SIGMA + SIGMA_SHARE * np.abs(one.velocity) * turned.rate_scale) ** 2
    return float(np.mean(np.abs(mended(one, turned) - wanted) ** 2 > GROSS * variance))
