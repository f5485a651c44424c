"""Where radars sit and which signs are turned, by Doppler alone: each radar's own motion against the car's, over a drive with bends.

A radar at (x, y) with the yaw a of a car with speed v and turn rate w moves with ((v - w y) + i w x) exp(-i a) in its own frame. So its
motion is A v + B w: A tells the yaw and the scale of the speed, B the place. A turned sign of azimuths, range rates or turn rate shows as a
place that no radar has, or that looks inwards.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from echogrid.config.tables import Body
from echogrid.judging.recorded import RadarTrack, Track
from echogrid.judging.sensor_velocity import sensor_velocity
from echogrid.judging.weighing import MOVING, REPEATED, SIGMA, SIGMA_SHARE

LEAST = 48  # scans that must tell
ROUNDS, CUT, FLOOR = 8, 3.0, 0.05  # of robust least squares; robust sigmas; m/s
SYSTEMATIC = 0.25  # m of a place, beyond the noise
PLACED = 1.0  # m: a place with a larger sigma says nothing
MIDDLE = 1.4  # m before the rear axle: what is ahead of it is a front radar's
SIGN_PRICE, NAMED = 2.0, 6.0  # of each turned sign; of a name that says otherwise
SURE = 4.0  # by how much the best explanation must be better
INWARD = 0.15  # m from the outline to a radar
BETTER = 0.4  # m: a place with a smaller sigma is better than the usual one
MIRRORED = "by Doppler, which does not tell whether left and right are mirrored, and the names do not either"


@dataclass(frozen=True, slots=True)
class Seen:
    """What one radar tells: yaw (rad), scale of the speed, place (m); with sigmas. `bends`: whether the place is known at all."""

    yaw: float
    yaw_sigma: float
    scale: float
    x: float
    y: float
    sigma: float
    spread: float  # m/s of what is left

    @property
    def bends(self) -> bool:
        return self.sigma < PLACED

    def signed(self, azimuth: int, rate: int, turn: int) -> Seen:
        """As it would have been seen with other signs."""
        x, y, yaw = self.x, self.y, self.yaw
        if azimuth < 0:
            x, yaw = -x, -yaw
        if turn < 0:
            x, y = -x, -y
        yaw = math.remainder(yaw + (math.pi if rate < 0 else 0.0), 2 * math.pi)
        return Seen(yaw, self.yaw_sigma, self.scale, x, y, self.sigma, self.spread)


@dataclass(frozen=True, slots=True)
class Signs:
    """By profile, of azimuth and range rate; of the yaw rate. `sure`: whether no other explanation is about as good."""

    azimuth: Mapping[str, int]
    rate: Mapping[str, int]
    turn: int
    sure: bool


def seen(radar: RadarTrack, speed: Track, yaw_rate: Track) -> Seen | None:
    """Robust least squares over the scans in which the radar moves; None where they are too few, or move otherwise than the car."""
    told = sensor_velocity(radar)
    moving = np.abs(told.velocity) > MOVING
    time, own = told.time[moving], told.velocity[moving]
    if len(own) < LEAST or len(speed) < 2 or len(yaw_rate) < 2:
        return None
    columns = np.stack((speed.at(time), yaw_rate.at(time)), axis=1).astype(complex)  # (S, 2)
    if float(np.mean(np.abs(columns[:, 0]) > MOVING / 4)) < 0.5:
        return None
    weight = np.ones(len(own))
    for _ in range(ROUNDS):
        normal = (columns.conj().T * weight) @ columns + np.diag([1e-9, 1e-6])
        found = np.linalg.solve(normal, (columns.conj().T * weight) @ own)
        left = np.abs(own - columns @ found)
        spread = max(1.4826 * float(np.median(left)), FLOOR)
        weight = np.where(left < CUT * spread, 1.0, (CUT * spread / np.maximum(left, 1e-9)) ** 2)
    if float(np.mean(left > CUT * (SIGMA + SIGMA_SHARE * np.abs(own)))) > 0.5:  # traffic, if the signals are the right ones
        return None
    sigmas = spread * np.sqrt(np.real(np.diag(np.linalg.inv(normal))) * REPEATED)
    yaw, scale = -float(np.angle(found[0])), float(np.abs(found[0]))
    place = complex(found[1] * np.exp(1j * yaw))
    return Seen(yaw, float(sigmas[0]) / max(scale, 1e-6), scale, place.imag, -place.real, math.hypot(float(sigmas[1]), SYSTEMATIC), spread)


def signs_of(told: Sequence[Seen | None], profiles: Sequence[str], corners: Sequence[str | None], free: set[str], *, turns: bool) -> Signs:
    """The fewest turned signs that put all radars where radars are, looking outwards, and where their names say.

    `free`: the profiles whose signs nobody has said yet. `turns`: whether that of the yaw rate is such a one.
    """
    kinds = list(dict.fromkeys(profiles))
    tried = []
    ways = [(1, -1) if kind in free else (1,) for kind in kinds for _ in range(2)]
    for turn, *each in product((1, -1) if turns else (1,), *ways):
        azimuth, rate = dict(zip(kinds, each[::2], strict=True)), dict(zip(kinds, each[1::2], strict=True))
        cost = SIGN_PRICE * sum(sign < 0 for sign in each) + 1.2 * SIGN_PRICE * (turn < 0)
        for one, kind, corner in zip(told, profiles, corners, strict=True):
            if one is not None:
                cost += _cost(one.signed(azimuth[kind], rate[kind], turn), corner)
        tried.append((cost, turn, azimuth, rate))
    tried.sort(key=lambda one: one[0])
    cost, turn, azimuth, rate = tried[0]
    return Signs(azimuth, rate, turn, len(tried) == 1 or tried[1][0] - cost >= SURE)


def _cost(one: Seen, corner: str | None) -> float:
    """Squared sigmas by which a place is none, or looks inwards; and what its name says."""
    body, ahead, aside = Body(), math.cos(one.yaw), math.sin(one.yaw)
    cost = 0.0
    if one.bends:
        front = body.length - body.rear_overhang
        beyond = max(-body.rear_overhang - one.x, one.x - front, 0.0)
        cost += min(beyond / one.sigma, 4.0) ** 2
        if (one.x - MIDDLE) * ahead < 0:
            cost += min(abs(one.x - MIDDLE) / one.sigma, 3.0) ** 2 * abs(ahead)
        if one.y * aside < 0:
            cost += min(abs(one.y) / one.sigma, 3.0) ** 2 * abs(aside)
    if corner is not None:
        cost += NAMED * abs(ahead) * (ahead > 0) * corner.startswith("rear") + NAMED * abs(ahead) * (ahead < 0) * corner.startswith("front")
        cost += NAMED * abs(aside) * (aside > 0) * corner.endswith("right") + NAMED * abs(aside) * (aside < 0) * corner.endswith("left")
    return cost


@dataclass(frozen=True, slots=True)
class Placed:
    """A radar's mount with what is uncertain of it."""

    name: str
    x: float
    y: float
    yaw_deg: float
    about_place: str
    about_yaw: str | None


def placed(told: Sequence[Seen | None], corners: Sequence[str | None], sure: bool) -> list[Placed]:
    """In the order given, with signs already turned; names are made different."""
    free = ["front_left", "front_right", "rear_left", "rear_right"]
    usual = {"front_left": 45.0, "front_right": -45.0, "rear_left": 135.0, "rear_right": -135.0}
    named = [_corner(one) if one is not None else corner for one, corner in zip(told, corners, strict=True)]
    for end in ("front", "rear"):
        if named.count(end) > 1:  # two that look straight ahead, or back, sit left and right
            named = [
                f"{end}_{'left' if one is not None and one.yaw > 0 else 'right'}" if name == end else name
                for one, name in zip(told, named, strict=True)
            ]
    out: list[Placed] = []
    used: dict[str, int] = {}
    for one, name in zip(told, named, strict=True):
        corner = name or next((spare for spare in free if spare not in (*named, *used)), "front_left")
        x, y = _nominal(corner)
        about_yaw = None
        if one is None:
            yaw, about_place = usual.get(corner, 0.0), "a guess; measure it"
            about_yaw = "a guess: no Doppler tells it; drive 20 s at more than 3 m/s past standing things, with bends"
        else:
            yaw, about_place = round(math.degrees(one.yaw), 1), "the usual place; measure it"
            if not sure:
                about_yaw = MIRRORED
            if one.sigma < BETTER:  # y bends range rates as small errors of azimuth do: the usual one is as good
                x = _within(one.x)
                about_place = f"by Doppler x = {one.x:.1f}, y = {one.y:.1f}, ±{one.sigma:.1f} m or more; measure it"
        used[corner] = used.get(corner, 0) + 1
        label = corner if used[corner] == 1 else f"{corner}_{used[corner]}"
        out.append(Placed(label, x, y, yaw, about_place, about_yaw))
    return out


def _corner(one: Seen) -> str:
    """By where it looks, and where it sits if it looks aside."""
    degrees = math.degrees(one.yaw)
    if abs(degrees) < 15:
        return "front"
    if abs(degrees) > 165:
        return "rear"
    side = "left" if degrees > 0 else "right"
    if one.bends and abs(abs(degrees) - 90) < 40:
        return f"{'front' if one.x > MIDDLE else 'rear'}_{side}"
    return f"{'front' if abs(degrees) < 90 else 'rear'}_{side}"


def _within(x: float) -> float:
    """The nearest place within the car's outline."""
    body = Body()
    return round(min(max(x, -body.rear_overhang), body.length - body.rear_overhang), 1)


def _nominal(corner: str) -> tuple[float, float]:
    body = Body()
    x = body.length - body.rear_overhang - INWARD if corner.startswith("front") else INWARD - body.rear_overhang
    y = body.width / 2 - INWARD
    return round(x, 2), round(y if corner.endswith("left") else -y if corner.endswith("right") else 0.0, 2)
