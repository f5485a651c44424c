"""The small errors that matter: mount yaws, time offsets, wheel scale, yaw-rate bias; and the manoeuvre that is missing to know them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from echogrid.core.motion.se2 import SE2
from echogrid.judging.finding import Finding, Undecided, surely
from echogrid.judging.recorded import RadarTrack, Track
from echogrid.judging.refining import Errors, Estimate, RadarErrors
from echogrid.judging.weighing import Hypothesis

# From where on an error is worth a word, and what recordings of sound sensors showed beyond the noise: sigmas that are added.
YAW_LIMIT, YAW_SYSTEMATIC = math.radians(1.0), math.radians(0.25)
PLACE_LIMIT, PLACE_SYSTEMATIC = 0.5, 0.2  # m
OFFSET_LIMIT, OFFSET_SYSTEMATIC = 0.03, 0.01  # s
SCALE_LIMIT, SCALE_SYSTEMATIC = 0.01, 0.002
BIAS_LIMIT = math.radians(0.2)  # per s
BIAS_BY_YAW = math.radians(0.3)  # azimuth errors that depend on speed or place, and look like a bias: times the speed, by the lever arm
KNOWN_YAW, KNOWN_OFFSET, KNOWN_SCALE, KNOWN_BIAS = math.radians(0.5), 0.02, 0.01, math.radians(0.25)  # one sigma: a larger one says nothing
CERTAIN = 5.0  # sigmas: what is so far off is told however little is known; less may be the mounts' yaws, in the first seconds of a drive
CHANGES = "changes of Doppler over the drive"


def small_errors(
    radars: Sequence[RadarTrack], best: Hypothesis, errors: Errors, speed: Track, doubtful: set[str]
) -> tuple[list[Finding], list[Undecided]]:
    """`radars` with the mounts of the hypothesis, turned; `doubtful`: those whose range rates fit nothing."""
    found: list[Finding] = []
    missing: list[Undecided] = []
    _yaws(radars, best, errors, doubtful, found, missing)
    _offsets(radars, errors, doubtful, found, missing)
    scale = _with(errors.scale, SCALE_SYSTEMATIC)
    if scale.sigma > KNOWN_SCALE and abs(scale.value) < CERTAIN * scale.sigma:
        missing.append(Undecided("needs_speed", "wheel scale: not known: drive for 20 s at more than 3 m/s past standing things"))
    elif scale.beyond(SCALE_LIMIT):
        sentence = f"speed: {-scale.value:+.1%} off what the radars measure (±{scale.sigma:.1%}): wheel radius or scale"
        sure = surely(scale.value, scale.sigma, SCALE_LIMIT)
        found.append(Finding("wheel_scale", sentence, 1 + scale.value, "", sure, "Doppler over the drive", subject="speed"))
    bias, rests = _bias(radars, errors, speed)
    if bias.beyond(BIAS_LIMIT):
        degrees = math.degrees(bias.value)
        sentence = f"yaw rate: is {degrees:+.2f} °/s off (±{math.degrees(bias.sigma):.2f})"
        sure = surely(bias.value, bias.sigma, BIAS_LIMIT)
        found.append(Finding("yaw_rate_bias", sentence, degrees, "deg/s", sure, rests, subject="yaw rate"))
    elif bias.sigma > KNOWN_BIAS:
        missing.append(Undecided("needs_stop", "yaw-rate bias: not known: stand still for 5 s with the engine on"))
    return found, missing


def _with(estimate: Estimate, systematic: float) -> Estimate:
    return Estimate(estimate.value, math.hypot(estimate.sigma, systematic))


def _bias(radars: Sequence[RadarTrack], errors: Errors, speed: Track) -> tuple[Estimate, str]:
    """As it was read at standstill; else from Doppler, with what errors of the azimuths may pretend."""
    if errors.standing is not None:
        return errors.standing, "the yaw rate while the wheels stood"
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
        if off.sigma > KNOWN_YAW:
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


def _offsets(radars: Sequence[RadarTrack], errors: Errors, doubtful: set[str], found: list[Finding], missing: list[Undecided]) -> None:
    """Of radars that differ from the others, and of those that agree."""
    own = {
        radar.name: _with(one.offset, OFFSET_SYSTEMATIC)
        for radar, one in zip(radars, errors.radars, strict=True)
        if radar.name not in doubtful
    }
    known = {name: one for name, one in own.items() if one.sigma < KNOWN_OFFSET}
    if len(known) < len(own):
        missing.append(Undecided("needs_acceleration", "time offsets: not all known: accelerate and brake a few times, and drive bends"))
    if not known:
        return
    apart = [name for name, one in known.items() if len(known) > 1 and _from_others(name, one, known).beyond(OFFSET_LIMIT)]
    for name in apart:
        one = known.pop(name)
        late = "late" if one.value < 0 else "early"
        sentence = f"radar {name}: its scans come {abs(one.value) * 1e3:.0f} ms {late} (±{one.sigma * 1e3:.0f} ms), unlike the others"
        sure = surely(one.value, one.sigma, OFFSET_LIMIT)
        found.append(Finding("time_offset", sentence, -one.value * 1e3, "ms", sure, CHANGES, (name,)))
    if not known:
        return
    weights = np.array([one.sigma**-2 for one in known.values()])
    values = np.array([one.value for one in known.values()])
    mean = Estimate(float((values * weights).sum() / weights.sum()), math.hypot(float(weights.sum() ** -0.5), OFFSET_SYSTEMATIC))
    if mean.beyond(OFFSET_LIMIT):
        later = "ego motion comes" if mean.value > 0 else f"the scans of {', '.join(known)} come"
        sentence = f"{later} {abs(mean.value) * 1e3:.0f} ms late (±{mean.sigma * 1e3:.0f} ms)"
        names, subject = ((), "motion") if mean.value > 0 else (tuple(known), "")
        sure = surely(mean.value, mean.sigma, OFFSET_LIMIT)
        found.append(Finding("time_offset", sentence, abs(mean.value) * 1e3, "ms", sure, CHANGES, names, subject))


def _from_others(name: str, one: Estimate, known: Mapping[str, Estimate]) -> Estimate:
    """A radar's offset less that of most others: one cause that all share explains more than one for each."""
    others = float(np.median([other.value for key, other in known.items() if key != name]))
    return Estimate(one.value - others, one.sigma)
