"""The small errors that matter: mounts, time offsets, wheel scale, yaw-rate bias; and the manoeuvre that is missing to know them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echogrid.core.motion.se2 import SE2
from echogrid.judging.finding import Finding, Undecided, surely
from echogrid.judging.offsets import time_offsets
from echogrid.judging.recorded import Flags, RadarTrack, Track
from echogrid.judging.refining import Errors, Estimate, RadarErrors, refine
from echogrid.judging.weighing import Hypothesis

# From where on an error is worth a word, and what recordings of sound sensors showed beyond the noise: sigmas that are added.
YAW_LIMIT, YAW_SYSTEMATIC = math.radians(1.0), math.radians(0.25)
PLACE_LIMIT, PLACE_SYSTEMATIC = 0.5, 0.2  # m
SCALE_LIMIT, SCALE_SYSTEMATIC = 0.01, 0.002
BIAS_LIMIT = math.radians(0.2)  # per s
BIAS_BY_YAW = math.radians(0.3)  # azimuth errors that depend on speed or place, and look like a bias: times the speed, by the lever arm
KNOWN_YAW, KNOWN_SCALE, KNOWN_BIAS = math.radians(0.5), 0.01, math.radians(0.25)  # one sigma: a larger one says nothing
PLACES = ("mount_x", "mount_y")
STANDING = "the yaw rate while the wheels stood"
YAW_RATE, NEEDS_STOP = "yaw rate", "needs_stop"
ANY_TURN, TURN_LIMIT = 3.0, 0.1  # prior sigma of a scale of the yaw rate that may be anything, and from where on it is worth a word
CERTAIN = 5.0  # sigmas: what is so far off is told however little is known; less may be other errors, in the first seconds of a drive


def small_errors(
    radars: Sequence[RadarTrack], best: Hypothesis, errors: Errors, speed: Track, doubtful: set[str]
) -> tuple[list[Finding], list[Undecided]]:
    """`radars` with the mounts of the hypothesis, turned; `doubtful`: those whose range rates fit nothing."""
    found: list[Finding] = []
    missing: list[Undecided] = []
    _yaws(radars, best, errors, doubtful, found, missing)
    late, unknown = time_offsets(radars, errors, doubtful)
    found, missing = [*found, *late], [*missing, *unknown]
    scale = _with(errors.scale, SCALE_SYSTEMATIC)
    if scale.sigma > KNOWN_SCALE and abs(scale.value) < CERTAIN * scale.sigma:
        missing.append(Undecided("needs_speed", "wheel scale: not known: drive for 20 s at more than 3 m/s past standing things"))
    elif scale.beyond(SCALE_LIMIT):
        sentence = f"speed: {-scale.value:+.1%} off what the radars measure (±{scale.sigma:.1%}): wheel radius or scale"
        sure = surely(scale.value, scale.sigma, SCALE_LIMIT)
        found.append(Finding("wheel_scale", sentence, 1 + scale.value, "", sure, "Doppler over the drive", subject="speed"))
    about, unsure = about_bias(*_bias(radars, errors, speed))
    return [*found, *about], [*missing, *unsure]


def about_bias(bias: Estimate, rests: str, sigmas: float = 2.0) -> tuple[list[Finding], list[Undecided]]:
    """What is said of the yaw rate's bias (rad/s), by what it rests on; `sigmas` that it must be beyond its limit."""
    told = f"{math.degrees(bias.value):+.2f} °/s off (±{math.degrees(bias.sigma):.2f})"
    if bias.beyond(BIAS_LIMIT, sigmas):
        sure = surely(bias.value, bias.sigma, BIAS_LIMIT)
        return [Finding("yaw_rate_bias", f"yaw rate: is {told}", math.degrees(bias.value), "deg/s", sure, rests, subject=YAW_RATE)], []
    if bias.sigma > KNOWN_BIAS:
        return [], [Undecided(NEEDS_STOP, "yaw-rate bias: not known: stand still for 5 s with the engine on")]
    if abs(bias.value) > BIAS_LIMIT and rests != STANDING:
        return [], [Undecided(NEEDS_STOP, f"yaw-rate bias: perhaps {told}: stand still for 5 s with the engine on")]
    return [], []


def turned_otherwise(
    radars: Sequence[RadarTrack],
    agrees: Sequence[Flags],
    best: Hypothesis,
    errors: Errors,
    speed: Track,
    yaw_rate: Track,
    doubtful: set[str],
    bends: bool,
) -> tuple[Errors, list[Finding], list[Undecided]] | None:
    """What is said instead if one factor of the yaw rate explains where the radars seem to sit, of which each alone would be elsewhere.

    A radar's place shows by how it swings in bends, which is the yaw rate times the place. `bends`: whether the car turned enough.
    """
    displaced = _displaced(small_errors(radars, best, errors, speed, doubtful)[0])
    if len(radars) < 2 or (displaced < 2 and not bends):
        return None
    free = refine(radars, agrees, speed, yaw_rate, ANY_TURN).turn_scale
    if not free.beyond(TURN_LIMIT):
        return None
    factor = -1.0 if abs(free.value + 2.0) < max(2 * free.sigma, TURN_LIMIT) else 1.0 + free.value
    otherwise = refine(radars, agrees, speed, replace(yaw_rate, value=yaw_rate.value * factor))
    found, missing = small_errors(radars, best, otherwise, speed, doubtful)
    if _displaced(found) > max(displaced - 1, 0):
        return None
    rests, sure = "Doppler in bends, by where the radars sit", surely(free.value, free.sigma, TURN_LIMIT)
    if factor < 0:
        sentence = "yaw rate: the radars see the car turn the other way"
        found.insert(0, Finding("yaw_rate_sign", sentence, -1.0, "", sure, rests, subject=YAW_RATE))
    if factor != -1.0:
        sentence = f"yaw rate: must be multiplied by {abs(factor):.2f} (±{free.sigma:.2f}) to fit the radars"
        found.insert(0, Finding("yaw_rate_scale", sentence, abs(factor), "", sure, rests, subject=YAW_RATE))
    return otherwise, found, missing


def _displaced(found: Sequence[Finding]) -> int:
    return sum(one.code in PLACES for one in found)


def _with(estimate: Estimate, systematic: float) -> Estimate:
    return Estimate(estimate.value, math.hypot(estimate.sigma, systematic))


def _bias(radars: Sequence[RadarTrack], errors: Errors, speed: Track) -> tuple[Estimate, str]:
    """As it was read at standstill; else from Doppler, with what errors of the azimuths may pretend."""
    if errors.standing is not None:
        return errors.standing, STANDING
    places = np.array([radar.mount.base_from_sensor.x for radar in radars])
    lever = max(float(np.ptp(places)), float(np.abs(places).max()) / 2, 0.5)
    usual = float(np.median(np.abs(speed.value)))
    return _with(errors.bias, BIAS_BY_YAW * usual / lever), "Doppler over the drive"


def _yaws(
    radars: Sequence[RadarTrack], best: Hypothesis, errors: Errors, doubtful: set[str], found: list[Finding], missing: list[Undecided]
) -> None:
    for radar, one, own in zip(radars, best.radars, errors.radars, strict=True):
        if radar.name in doubtful:
            continue
        entry = radars[one.mount].name  # whose place it has
        _place(entry, radar.mount.base_from_sensor, own, found)
        estimate = _with(own.yaw, YAW_SYSTEMATIC)
        off = Estimate(math.remainder(own.yaw.value + one.yaw, 2 * math.pi), estimate.sigma)
        if off.sigma > KNOWN_YAW and abs(off.value) < CERTAIN * off.sigma:
            missing.append(
                Undecided("needs_speed", f"radar {radar.name}: mount yaw not known: drive for 20 s at more than 3 m/s past standing things")
            )
        elif off.beyond(YAW_LIMIT):
            true = math.remainder(radar.mount.base_from_sensor.yaw + own.yaw.value, 2 * math.pi)
            degrees, sigma = math.degrees(off.value), math.degrees(off.sigma)
            sentence = f"radar {entry}: its yaw is {math.degrees(true):.1f}°, {degrees:+.1f}° off the configured one (±{sigma:.1f}°)"
            sure = surely(off.value, off.sigma, YAW_LIMIT)
            found.append(Finding("mount_yaw", sentence, math.degrees(true), "deg", sure, "Doppler over the drive", (entry,)))


def _place(name: str, place: SE2, own: RadarErrors, found: list[Finding]) -> None:
    """x and y, which show in bends alone."""
    for axis, configured, off in (("x", place.x, own.x), ("y", place.y, own.y)):
        estimate = _with(off, PLACE_SYSTEMATIC)
        if estimate.beyond(PLACE_LIMIT):
            true = configured + off.value
            sentence = f"radar {name}: sits at {axis} = {true:.1f} m, {off.value:+.1f} m off the configured place (±{estimate.sigma:.1f} m)"
            sure = surely(estimate.value, estimate.sigma, PLACE_LIMIT)
            found.append(Finding(f"mount_{axis}", sentence, true, "m", sure, "Doppler in bends", (name,)))
