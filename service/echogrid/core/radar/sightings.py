"""Where standing things were seen, look by look, and what a pair of sightings says of the way between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import IDENTITY
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep

Complex = NDArray[np.complex128]
SOONEST_NS, LATEST_NS = 2_000_000_000, 6_000_000_000  # between two sightings of a thing
NEAREST = 1.0  # m
RANGE_NOISE, AZIMUTH_NOISE, EXTENT = 0.15, 0.025, 0.25  # m, rad, and m between two reflections of a thing
APART = 2.5  # m between two sightings of a thing, at most, beside what two sigmas of their azimuths make


class Turned(msgspec.Struct, frozen=True, eq=False):
    """Integrals since the start over the time in which the car drove (…, 3): of 1 (s), of the gyro (rad) and of what was taken off it
    (rad); and of each times the place in odom, x + iy."""

    sums: Floats
    moments: Complex


class Look(msgspec.Struct, frozen=True, eq=False):
    """Standing things as radars saw them in a fifth of a second: places (N,) in odom, x + iy in m; from the radar, along odom's axes (N,);
    where the car was (N,), and how it had turned by then (N, 3); covariances (3, N), xx, xy and yy in m²; numbers of the radars (N,)."""

    stamp_ns: int
    cars: Complex
    turned: Turned
    places: Complex
    arms: Complex
    covariances: Floats
    radars: NDArray[np.int64]


class Pairs(msgspec.Struct, frozen=True, eq=False):
    """The same thing, perhaps, seen twice by a radar (P,). `apart`: the newer place less the older one, had the gyro been taken as it is.

    Derivatives of it (P,) complex: `by_bias` per rad/s, `by_turn` by the share of the turns, `by_way` by the share of the way, `by_yaw` of
    the radar's mount. `newer`: which of the new sightings (P,), `radars` (P,), `covariances` (3, P).
    """

    newer: NDArray[np.int64]
    radars: NDArray[np.int64]
    apart: Complex
    covariances: Floats
    by_bias: Complex
    by_turn: Complex
    by_way: Complex
    by_yaw: Complex


def look(sweeps: Sequence[tuple[Sweep, Turned]], numbers: Mapping[str, int], noise: GateNoise, most: int) -> Look | None:
    """What stands in the scans of trusted radars, each sweep with how the car had turned, thinned to `most`; None where nothing does."""
    placed = [one for sweep, _ in sweeps for one in sweep.placed]
    standing = np.flatnonzero(np.concatenate([sweep.standing(noise, NEAREST) for sweep, _ in sweeps]))
    if len(standing) == 0:
        return None
    count = min(len(standing), most)
    kept = standing[np.arange(count) * len(standing) // count]
    whose = np.repeat(np.arange(len(placed)), np.concatenate([sweep.sizes for sweep, _ in sweeps]))[kept]
    sensors = np.concatenate([sweep.sensors(IDENTITY)[1] for sweep, _ in sweeps])
    cars = np.array([one.ego.odom_from_base for one in placed])
    turn = np.exp(1j * sensors[:, 2])[whose]
    origin, car = (np.ascontiguousarray(some[:, :2]).view(np.complex128)[whose, 0] for some in (sensors, cars))
    radar = np.array([numbers[one.scan.sensor] for one in placed])[whose]
    turned = [so_far for sweep, so_far in sweeps for _ in sweep.placed]
    so_far = Turned(np.array([one.sums for one in turned])[whose], np.array([one.moments for one in turned])[whose])
    far, cos, sin = np.concatenate([(sweep.range, *sweep.azimuth) for sweep, _ in sweeps], axis=1)[:, kept]
    arm = np.stack((far * cos, far * sin), axis=1).view(np.complex128)[:, 0] * turn
    along, across = RANGE_NOISE**2 + EXTENT**2, (AZIMUTH_NOISE * far) ** 2 + EXTENT**2
    c, s = arm.real / far, arm.imag / far
    covariance = np.stack((along * c * c + across * s * s, (along - across) * c * s, along * s * s + across * c * c))
    return Look(max([one.ego.stamp_ns for one in placed]), car, so_far, origin + arm, arm, covariance, radar)


def pairs(looks: Sequence[Look], new: int) -> Pairs:
    """Of the last `new` looks with those before, each radar's with its own: what is not far apart by dead reckoning."""
    sizes = [len(one.places) for one in looks]
    ends = np.concatenate(([0], np.cumsum(sizes)))
    places, arms, cars, radars = (np.concatenate([getattr(one, name) for one in looks]) for name in ("places", "arms", "cars", "radars"))
    reach = APART + 2.0 * AZIMUTH_NOISE * np.abs(arms)
    stamps, points = [one.stamp_ns for one in looks], places.view(np.float64).reshape(-1, 2)
    found, count = [np.zeros((2, 0), np.int64)], np.empty(1, np.int64)
    for n in range(len(looks) - new, len(looks)):
        first, last = np.searchsorted(stamps, (stamps[n] - LATEST_NS, stamps[n] - SOONEST_NS + 1)).tolist()
        mine, old = slice(ends[n], ends[n + 1]), slice(ends[first], ends[last])
        near = np.empty((2, sizes[n] * (ends[last] - ends[first])), np.int64)
        loops.nearby(points[mine], reach[mine], radars[mine], points[old], radars[old], near, count)
        found.append(near[:, : int(count[0])] + np.array(((ends[n],), (ends[first],))))
    i, j = np.concatenate(found, axis=1)
    sums, moments = (np.concatenate([getattr(one.turned, name) for one in looks]) for name in ("sums", "moments"))
    covariances = np.concatenate([one.covariances for one in looks], axis=1)
    turned = 1j * ((sums[i] - sums[j]) * places[i, None] - (moments[i] - moments[j]))
    between, arm = places[i] - places[j], 1j * (arms[i] - arms[j])
    return Pairs(
        i, radars[i], between + turned[:, 2], covariances[:, i] + covariances[:, j], -turned[:, 0], turned[:, 1], cars[i] - cars[j], arm
    )
