"""The spine of a check: from arrays to findings, what is grossest first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from echogrid.core.health import SensorHealth
from echogrid.judging.by_hypothesis import findings_of
from echogrid.judging.finding import Finding, Undecided, surely
from echogrid.judging.recorded import RadarTrack, Recorded, Track
from echogrid.judging.refining import Errors, refine
from echogrid.judging.sectors import MUCH, blind, dead_sector, lost_scans, outside
from echogrid.judging.sensor_velocity import SensorVelocity, sensor_velocity
from echogrid.judging.small_errors import PLACES, small_errors, turned_otherwise
from echogrid.judging.values import (
    LEAPS,
    azimuth_factor,
    range_factor,
    range_unit,
    ranges_leap,
    ranges_say,
    speed_leaps,
    stands_out,
    wheels_say,
    yaw_rate_leaps,
)
from echogrid.judging.weighing import NO_MISTAKE, Hypothesis, Sample, Weighed, placed, sample, told_ratio, unexplained, weigh

LOST = 0.05  # share of the scans, or of motion's frames
WRONG = 0.5  # share of the scans whose checksum fails, from which on it is the checksum that is wrong
LEAST_SUPPORT = 0.35  # share of a scan's detections that fit one motion; below, range rates or azimuths are no measurements
UNEXPLAINED = 0.5  # share of a radar's scans that the best hypothesis leaves
LEAST_WORTH = 6.0  # independent scans in which a radar moved
TURN = math.radians(5.0)  # per s
BENDS = 2.0  # s of turning at least that fast
FAR = 60.0  # m that must be driven before anything is said of ranges, or that a radar sees nothing somewhere


@dataclass(frozen=True, slots=True)
class Judgement:
    """`errors` and `weighed` are None where the recording does not allow any judgement by Doppler, and `errors` where no radar's range
    rates fit ego motion; `velocities` one for each radar.
    """

    findings: tuple[Finding, ...]
    undecided: tuple[Undecided, ...]
    weighed: Weighed | None
    errors: Errors | None
    judged: tuple[RadarTrack, ...]  # those that `weighed` and `errors` speak of, mended
    mended: tuple[RadarTrack, ...]  # all
    velocities: tuple[SensorVelocity, ...]


@dataclass(frozen=True, slots=True)
class Doppler:
    """What Doppler and ego motion together say; nothing of it where one of them is missing."""

    weighed: Weighed | None = None
    errors: Errors | None = None
    judged: tuple[RadarTrack, ...] = ()
    findings: tuple[Finding, ...] = ()
    undecided: tuple[Undecided, ...] = ()


def judge(recorded: Recorded, profiles: Mapping[str, str]) -> Judgement:
    """`profiles`: by radar, whose signs and units are one line of configuration."""
    findings = _motion_values(recorded)
    motion_sound = not findings and len(recorded.speed) > 1 and len(recorded.yaw_rate) > 1
    radars, about_azimuths = _azimuths(recorded.radars)
    findings += about_azimuths
    leaping = {name for one in about_azimuths if one.code == "byte_order" for name in one.radars}
    velocities = tuple(sensor_velocity(radar) for radar in radars)
    measured = [n for n, radar in enumerate(radars) if radar.name not in leaping]
    doppler = _by_doppler(recorded, radars, velocities, measured, profiles) if motion_sound else Doppler()
    mended = {radar.name: radar for radar in doppler.judged}
    radars = tuple(mended.get(radar.name, radar) for radar in radars)
    findings += doppler.findings
    undecided = list(doppler.undecided)
    factor = 1.0 if doppler.weighed is None else abs(doppler.weighed.best.speed_factor)
    if factor * _way(recorded.speed) >= FAR:
        findings += _ranges([radar for radar in radars if radar.name not in leaping], profiles)
        findings += _sight(radars, leaping)
    else:
        sentence = f"ranges, and where each radar sees: not judged on so short a way: drive at least {FAR:.0f} m"
        undecided.append(Undecided("needs_distance", sentence))
    return Judgement(tuple(findings), tuple(undecided), doppler.weighed, doppler.errors, doppler.judged, radars, velocities)


def counted(recorded: Recorded, health: Mapping[str, SensorHealth], bad_motion: float, lost_motion: float) -> list[Finding]:
    """From the counters: `bad_motion` and `lost_motion` are shares of motion's frames."""
    found = []
    for radar in recorded.radars:
        counts = health[radar.name]
        whole = max(len(radar) + counts.incomplete + counts.bad_crc, 1)
        if counts.bad_crc > WRONG * whole:
            sentence = f"radar {radar.name}: {counts.bad_crc / whole:.0%} of its checksums are wrong: another algorithm, or another layout"
            found.append(Finding("checksum", sentence, counts.bad_crc / whole, "of its scans", 0.99, f"{whole} scans", (radar.name,)))
            continue
        torn = (counts.incomplete + counts.bad_crc) / whole
        missing = lost_scans(recorded.steps(radar.time))
        lost = max(torn, missing)
        if lost > LOST:
            how = (
                f"{counts.incomplete} incomplete, {counts.bad_crc} with a wrong checksum"
                if torn >= missing
                else "by the time between its scans"
            )
            sentence = f"radar {radar.name}: {lost:.0%} of its scans are lost ({how})"
            found.append(Finding("lost_frames", sentence, lost, "of its scans", 0.99, f"{whole} scans", (radar.name,)))
    if bad_motion > WRONG:
        sentence = f"motion: {bad_motion:.0%} of its frames have a wrong checksum, counter or value"
        found.append(Finding("checksum", sentence, bad_motion, "of its frames", 0.95, "frames", subject="motion"))
    elif lost_motion > LOST:
        sentence = f"motion: {lost_motion:.0%} of its frames are missing, by their counters"
        found.append(Finding("lost_frames", sentence, lost_motion, "of its frames", 0.99, "counters", subject="motion"))
    return found


def _motion_values(recorded: Recorded) -> list[Finding]:
    found = []
    for subject, share in (("speed", speed_leaps(recorded.speed)), ("yaw rate", yaw_rate_leaps(recorded.yaw_rate))):
        if share > LEAPS:
            sentence = f"{subject}: {share:.0%} of its steps are beyond what a car can do: another byte order, or other bits"
            found.append(Finding("byte_order", sentence, share, "of its steps", 0.95, "steps between samples", subject=subject))
    return found


def _azimuths(radars: Sequence[RadarTrack]) -> tuple[tuple[RadarTrack, ...], list[Finding]]:
    """The radars with the azimuths that their range rates ask for."""
    mended, found = [], []
    for radar in radars:
        factor, support, before = azimuth_factor(radar)
        rests = f"range rates within single scans: {support:.0%} of the detections fit one motion, {before:.0%} as they are"
        if factor != 1.0:
            code = "azimuth_unit" if abs(factor) > 10 or abs(factor) < 0.1 else "azimuth_scale"
            sentence = f"radar {radar.name}: azimuths must be multiplied by {factor:.4g}" + _unit_of(factor)
            found.append(Finding(code, sentence, factor, "", 0.95, rests, (radar.name,)))
        elif support < LEAST_SUPPORT:
            sentence = f"radar {radar.name}: its range rates and azimuths fit no motion within its scans: another byte order, or other bits"
            found.append(Finding("byte_order", sentence, before, "of its detections", 0.8, rests, (radar.name,)))
        mended.append(radar if factor == 1.0 else replace(radar, azimuth=radar.azimuth * factor))
    return tuple(mended), found


def _ranges(radars: Sequence[RadarTrack], profiles: Mapping[str, str]) -> list[Finding]:
    """What is wrong with ranges, where range rates are right. Most radars of a profile must agree, for rows of posts deceive one."""
    found = []
    told = {radar.name: range_factor(radar) for radar in radars}
    for radar in radars:
        factor, score, before = told[radar.name]
        if factor == 1.0 and (unit := range_unit(radar)) != 1.0:
            middle = float(np.median(radar.range))
            sentence = f"radar {radar.name}: ranges must be multiplied by {unit:g}: half of them are below {middle:.3g} m"
            found.append(Finding("range_unit", sentence, unit, "", 0.95, "ranges", (radar.name,)))
            continue
        equal = [told[other.name][0] for other in radars if profiles[other.name] == profiles[radar.name]]
        factor = factor if equal.count(factor) > len(equal) / 2 else 1.0
        rests = f"ranges against range rates from scan to scan: {score:.0f} sigmas, {before:.0f} as they are"
        if factor != 1.0:
            code = "range_unit" if factor in (0.01, 100.0) else "range_scale"
            sentence = f"radar {radar.name}: ranges must be multiplied by {factor:g} to change as its range rates say"
            found.append(Finding(code, sentence, factor, "", 0.95, rests, (radar.name,)))
        elif ranges_leap(radar):
            sentence = (
                f"radar {radar.name}: its ranges leap from scan to scan, whatever its range rates say: another byte order, or other bits"
            )
            found.append(Finding("byte_order", sentence, before, "sigmas", 0.8, rests, (radar.name,)))
    return found


def _unit_of(factor: float) -> str:
    return ": they are degrees, not radians" if factor < 0.1 else ": they are radians, not degrees" if factor > 10 else ""


def _by_doppler(
    recorded: Recorded,
    radars: Sequence[RadarTrack],
    velocities: Sequence[SensorVelocity],
    measured: Sequence[int],
    profiles: Mapping[str, str],
) -> Doppler:
    """Weighs the hypotheses, mends the drive by the best, and refines what is left. `measured`: whose values are measurements at all."""
    samples = {n: sample(velocities[n], recorded.speed, recorded.yaw_rate) for n in measured}
    samples = {n: replace(one, by_ranges=ranges_say(radars[n], told_ratio(one.ratio))) for n, one in samples.items()}
    told = [n for n, one in samples.items() if one.worth >= LEAST_WORTH]
    undecided = [
        Undecided("needs_speed", f"radar {radars[n].name}: not judged by Doppler: drive for 20 s at more than 3 m/s past standing things")
        for n in samples
        if n not in told
    ]
    for n in [n for n in told if _among_movers(radars[n], samples[n], recorded)]:
        told.remove(n)
        sentence = f"radar {radars[n].name}: most of what it sees moves: drive for 20 s at more than 3 m/s past standing things"
        undecided.append(Undecided("needs_speed", sentence))
    if not told:
        return Doppler(undecided=tuple(undecided))
    chosen = [radars[n] for n in told]
    wheels = wheels_say(recorded)
    weighed = weigh([samples[n] for n in told], [one.mount for one in chosen], [profiles[one.name] for one in chosen], wheels)
    found = findings_of(weighed, chosen) if np.mean(weighed.unexplained) < UNEXPLAINED else []
    doubtful = set()
    for radar, left in zip(chosen, weighed.unexplained, strict=True):
        if left > UNEXPLAINED:
            doubtful.add(radar.name)
            sentence = f"radar {radar.name}: {left:.0%} of its scans fit neither ego motion nor any mistake that is known"
            found.append(Finding("unexplained", sentence, left, "of its scans", 0.8, "Doppler over the drive", (radar.name,)))
    mended, speed, yaw_rate = _mend(chosen, recorded, weighed.best)
    if len(doubtful) == len(chosen):
        return Doppler(weighed, None, tuple(mended), tuple(found), tuple(undecided))
    agrees = [velocities[n].agrees & (radars[n].name not in doubtful) for n in told]
    errors = refine(mended, agrees, speed, yaw_rate)
    small, missing = small_errors(mended, weighed.best, errors, speed, doubtful)
    bends = _bends(yaw_rate) >= BENDS
    turned = turned_otherwise(mended, agrees, weighed.best, errors, speed, yaw_rate, doubtful, bends)
    if turned is not None:
        errors, small, missing = turned
    if bends and turned is None and wheels * weighed.best.speed_factor * weighed.best.yaw_factor < 0:
        sentence = "wheels: the left one is the faster one in bends to the left: they have each other's signal"
        small.append(Finding("wheels_swapped", sentence, -1.0, "", 0.95, "the rear wheels' difference in bends", subject="speed"))
    if not bends:
        sentence = "signs of azimuth and yaw rate, and mirrored mounts, are told apart in bends alone: drive some of them, left and right"
        missing.append(Undecided("needs_turn", sentence))
        small = [one for one in small if one.code not in PLACES]
    return Doppler(weighed, errors, tuple(mended), tuple(found + small), (*undecided, *missing))


def _among_movers(radar: RadarTrack, scans: Sample, recorded: Recorded) -> bool:
    """Whether the car and the mount are right, but most of the little that the radar sees is traffic, which would seem to be a mistake."""
    left = unexplained(scans, NO_MISTAKE, NO_MISTAKE.radars[0], [radar.mount])
    return left > UNEXPLAINED and stands_out(radar, recorded.speed, recorded.yaw_rate)


def _way(speed: Track) -> float:
    """Metres driven, as decoded."""
    return float(np.abs(speed.value[1:]) @ np.minimum(np.diff(speed.time), 1.0)) if len(speed) > 1 else 0.0


def _bends(yaw_rate: Track) -> float:
    """Seconds of turning."""
    return float(np.count_nonzero(np.abs(yaw_rate.value) > TURN) * np.median(np.diff(yaw_rate.time)))


def _mend(radars: Sequence[RadarTrack], recorded: Recorded, best: Hypothesis) -> tuple[list[RadarTrack], Track, Track]:
    """The drive as it would be without the mistakes of the hypothesis."""
    out = []
    for radar, one in zip(radars, best.radars, strict=True):
        place = placed(radars[one.mount].mount, best.mounted).base_from_sensor
        out.append(
            replace(
                radar,
                mount=replace(radar.mount, base_from_sensor=place._replace(yaw=place.yaw + one.yaw)),
                azimuth=radar.azimuth * one.azimuth_sign,
                range_rate=radar.range_rate * one.rate_sign * one.rate_scale,
            )
        )
    speed = replace(recorded.speed, value=recorded.speed.value * best.speed_factor)
    return out, speed, replace(recorded.yaw_rate, value=recorded.yaw_rate.value * best.yaw_factor)


def _sight(radars: Sequence[RadarTrack], leaping: set[str]) -> list[Finding]:
    found = []
    covered = blind(radars)
    for n, share in covered:
        sentence = f"radar {radars[n].name}: sees {share:.0%} of what the others see: covered, or switched off"
        found.append(Finding("blocked", sentence, share, "of the others' detections", 0.9, "detections per scan", (radars[n].name,)))
    for radar in radars:
        if radar.name in leaping or any(radars[n] is radar for n, _ in covered):
            continue
        dead = dead_sector(radar)
        if dead is not None:
            right, left = (math.degrees(one) for one in dead)
            sentence = f"radar {radar.name}: sees nothing from azimuth {right:.0f}° to {left:.0f}°"
            found.append(Finding("blocked_sector", sentence, left - right, "deg", 0.9, "detections by azimuth", (radar.name,)))
        share, half = outside(radar)
        if share > MUCH:
            field = math.degrees(2 * radar.mount.half_fov)
            sentence = f"radar {radar.name}: {share:.0%} of its detections lie outside its field of view of {field:.0f}°"
            value = math.degrees(2 * half)
            found.append(Finding("field_of_view", sentence, value, "deg", surely(share, 0.02, MUCH), "azimuths", (radar.name,)))
    return found
