"""The mistakes that the best hypothesis assumes, one finding each."""

from __future__ import annotations

import math
from collections.abc import Sequence

from echogrid.core.motion.pose_convention import TURNED, Convention
from echogrid.judging.finding import Finding, Undecided
from echogrid.judging.recorded import RadarTrack
from echogrid.judging.weighing import CLOCKWISE, IN_RADIANS, MIRRORED, NEAR, Turned, Weighed

UNITS = {
    3.6: "m/s that are taken for km/h",
    1 / 3.6: "km/h that are taken for m/s",
    100.0: "m/s that are taken for cm/s",
    0.01: "cm/s that are taken for m/s",
}
STEADY, ASKEW = math.radians(12.0), math.radians(10.0)  # how far a pose's heading may scatter about the car's yaw, and be off in the mean
TURN_UNITS = {math.degrees(1): "rad/s that are taken for degrees/s", math.radians(1): "degrees/s that are taken for rad/s"}


def unit_of(factor: float) -> float | None:
    """The unit's ratio that a factor is near to, or None."""
    return next((ratio for ratio in UNITS if abs(abs(factor) / ratio - 1) < NEAR), None)


def findings_of(weighed: Weighed, radars: Sequence[RadarTrack]) -> list[Finding]:
    """By radars in the order in which they were weighed."""
    best = weighed.best
    rests = (
        f"Doppler of {len(radars)} radars over the drive: cost {weighed.cost:.0f} with it, {weighed.as_configured:.0f} as configured, "
        f"{weighed.next_best:.0f} with the next best explanation"
    )
    found: list[Finding] = []

    def say(code: str, sentence: str, value: float, names: Sequence[str] = (), subject: str = "", unit: str = "") -> None:
        found.append(Finding(code, sentence, value, unit, min(weighed.confidence, 0.999), rests, tuple(names), subject))

    if best.speed_factor < 0:
        say("speed_sign", "speed: the radars see the car go the other way", -1.0, subject="speed")
    if abs(best.speed_factor) != 1.0:
        ratio = unit_of(best.speed_factor)
        known = "" if ratio is None else f": {UNITS[ratio]}"
        code = "speed_scale" if ratio is None else "speed_unit"
        say(
            code,
            f"speed: must be multiplied by {abs(best.speed_factor):.4g} to fit the radars{known}",
            abs(best.speed_factor),
            subject="speed",
        )
    if best.yaw_factor < 0:
        say("yaw_rate_sign", "yaw rate: the radars see the car turn the other way", -1.0, subject="yaw rate")
    if abs(best.yaw_factor) != 1.0:
        known = TURN_UNITS[min(TURN_UNITS, key=lambda one: abs(one - abs(best.yaw_factor)))]
        say(
            "yaw_rate_unit",
            f"yaw rate: must be multiplied by {abs(best.yaw_factor):.4g}: {known}",
            abs(best.yaw_factor),
            subject="yaw rate",
        )
    names = [radar.name for radar in radars]
    if best.mounted == CLOCKWISE:
        say("mount_yaw_sign", "all radars' yaw_deg have the wrong sign: given clockwise, expected counter-clockwise", -1.0, names)
    if best.mounted == IN_RADIANS:
        say("mount_yaw_unit", "all radars' yaw_deg are radians, expected degrees", math.degrees(1), names)
    if best.mounted == MIRRORED:
        say("mount_y_sign", "all radars' y have the wrong sign: positive to the right, expected to the left", -1.0, names)
    _order(best.radars, radars, say)
    for code, what, key in (
        ("azimuth_sign", "azimuth (or y) has the wrong sign", "azimuth_sign"),
        ("range_rate_sign", "range rate has the wrong sign", "rate_sign"),
    ):
        wrong = [name for name, one in zip(names, best.radars, strict=True) if getattr(one, key) < 0]
        if wrong:
            say(code, f"radar{'s' * (len(wrong) > 1)} {', '.join(wrong)}: {what}", -1.0, wrong)
    for name, one in zip(names, best.radars, strict=True):
        if one.rate_scale != 1.0:
            ratio = unit_of(one.rate_scale)
            known = "" if ratio is None else f": {UNITS[ratio]}"
            code = "range_rate_scale" if ratio is None else "range_rate_unit"
            say(code, f"radar {name}: range rates must be multiplied by {one.rate_scale:.4g}{known}", one.rate_scale, [name])
    return found


def findings_of_pose(found: Convention, poses: int) -> tuple[list[Finding], list[Undecided]]:
    """What is wrong with the axes and headings of so many poses from outside."""
    rests = f"{poses} poses beside the car's own motion, which turned by {math.degrees(found.turned):.0f}°"

    def say(code: str, what: str, value: float, unit: str) -> tuple[list[Finding], list[Undecided]]:
        return [Finding(code, f"pose: {what}", value, unit, 0.95, rests, subject="pose")], []

    if found.mirrored:
        what = "its places go the other way round than the car: two axes, or latitude and longitude, are swapped, or one has the wrong sign"
        return say("pose_mirrored", what, -1.0, "")
    if found.as_told < STEADY and abs(found.apart) < ASKEW:
        return [], []
    if found.turned < TURNED:
        off = abs(math.degrees(found.apart))
        sentence = f"pose: its heading is {off:.0f}° off its course; whether by sign, unit or angle is not known: drive bends"
        return [], [Undecided("needs_turn", sentence)]
    if found.scatter > STEADY:
        return [], []
    if abs(abs(found.factor) - 1.0) > NEAR:
        unit = "degrees that are taken for radians" if abs(found.factor) < 1.0 else "radians that are taken for degrees"
        way = "" if found.factor > 0.0 else ", and clockwise"
        return say("pose_heading_unit", f"its heading must be multiplied by {found.factor:.4g}: {unit}{way}", found.factor, "")
    offset = math.degrees(found.offset)
    if found.factor < 0.0:
        what = f"its heading has the wrong sign: the car's yaw is {offset:.0f}° less what is read (clockwise for counter-clockwise)"
        return say("pose_heading_sign", what, offset, "deg")
    return say("pose_heading_offset", f"its heading is off by {offset:+.0f}° from where the car drives", offset, "deg")


def _order(turned: Sequence[Turned], radars: Sequence[RadarTrack], say: object) -> None:
    """Who has whose mount."""
    assert callable(say)
    pairs = [(n, one.mount) for n, one in enumerate(turned) if one.mount > n and turned[one.mount].mount == n]
    moved = [n for n, one in enumerate(turned) if one.mount != n]
    if not moved:
        return
    names = [radars[n].name for pair in pairs for n in pair] if len(moved) == 2 * len(pairs) else [radars[n].name for n in moved]
    if len(pairs) == 2 and len(moved) == 4:
        places = [(radars[a].mount.base_from_sensor, radars[b].mount.base_from_sensor) for a, b in pairs]
        lengthwise = all(abs(a.x - b.x) > 1.0 and a.y * b.y > 0 for a, b in places)
        across = all(abs(a.x - b.x) < 0.5 and a.y * b.y < 0 for a, b in places)
        if lengthwise:
            say("front_rear_swapped", "the front radars have the places of the rear ones, and the other way round", 4.0, names)
            return
        if across:
            say("left_right_swapped", "the left radars have the places of the right ones, and the other way round (y mirrored)", 4.0, names)
            return
    if len(moved) == 2 * len(pairs):
        for a, b in pairs:
            say(
                "radars_swapped",
                f"radars {radars[a].name} and {radars[b].name} have each other's place",
                2.0,
                [radars[a].name, radars[b].name],
            )
        return
    order = ", ".join(f"{radars[n].name} sits where {radars[turned[n].mount].name} is said to" for n in moved)
    say("radars_swapped", f"radars are mixed up: {order}", float(len(moved)), names)
