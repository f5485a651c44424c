"""A report of `echogrid check` as text and as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from echogrid.commands.judged import Report
from echogrid.config.loading import remarks
from echogrid.config.tables import Config
from echogrid.core.messages import Floats
from echogrid.judging.finding import Finding
from echogrid.judging.listening import SPEED, YAW_RATE, Listener
from echogrid.judging.mending import MOTION


def said(report: Report) -> list[tuple[Finding, list[str]]]:
    """Each finding with the lines that mend it."""
    return [(finding, fix.lines(report.listener.config)) for finding, fix in zip(report.findings, report.fixes, strict=True)]


def as_document(report: Report, config: Path, log: Path | None) -> dict[str, Any]:
    """The report as JSON takes it, of a log or of live buses; docs/checking.md describes every key."""
    listener, health = report.listener, report.listener.health
    estimates = _estimates(report)
    radars = {}
    for radar in report.recorded.radars:
        counts = health.sensors[radar.name]
        radars[radar.name] = {
            **_timing(radar.time),
            **{key: getattr(counts, key) for key in ("incomplete", "repeated", "wrong_cycle", "bad_crc", "invalid", "truncated")},
            "detections_median": float(np.median(radar.counts)) if len(radar) else 0.0,
            "range_m": _span(radar.range),
            "azimuth_deg": _span(np.degrees(radar.azimuth)),
            "range_rate_m_s": _span(radar.range_rate),
            "estimates": estimates.get(radar.name),
        }
    return {
        "config": str(config),
        "log": None if log is None else str(log),
        "seconds": round(report.times.seconds, 3),
        **{key: getattr(health, key) for key in ("frames", "unknown_frames", "bad_frames", "lost_frames")},
        "unread_buses": _unread(listener.config),
        "other_ids": [{"channel": channel, "id": number, "frames": count} for (channel, (number, _)), count in _others(listener, 20)],
        "motion": {
            SPEED: {**_timing(report.recorded.speed.time), "m_s": _span(report.recorded.speed.value)},
            YAW_RATE: {**_timing(report.recorded.yaw_rate.time), "rad_s": _span(report.recorded.yaw_rate.value)},
            "estimates": estimates.get(MOTION),
        },
        "radars": radars,
        "findings": [{**msgspec.structs.asdict(_Told.of(finding, lines))} for finding, lines in said(report)],
        "undecided": [{"code": one.code, "sentence": one.sentence} for one in report.judgement.undecided],
    }


def configured(config: Config, path: Path, ids: int) -> dict[str, Any]:
    """What a configuration alone says, under the keys of a report where both have them."""
    radars = {radar.name: {"bus": radar.bus, "profile": radar.profile} for radar in config.radar}
    buses = {"buses": [bus.name for bus in config.bus], "unread_buses": _unread(config)}
    return {"config": str(path), "log": None, **buses, "ids": ids, "radars": radars, "findings": [], "undecided": []}


def _unread(config: Config) -> list[str]:
    return [bus.name for bus in config.bus if bus not in config.read_buses]


class _Told(msgspec.Struct):
    """A finding as JSON has it."""

    code: str
    radars: list[str]
    subject: str
    sentence: str
    value: float
    unit: str
    confidence: float
    rests_on: str
    fix: list[str]

    @classmethod
    def of(cls, finding: Finding, lines: list[str]) -> _Told:
        value, confidence = round(finding.value, 6), round(finding.confidence, 3)
        who = list(finding.radars), finding.subject
        return cls(finding.code, *who, finding.sentence, value, finding.unit, confidence, finding.rests_on, lines)


def _timing(time: Floats) -> dict[str, float]:
    """Samples, their rate by the median step (by all of them where times repeat), the longest gap, and the spread of the steps."""
    steps = np.diff(time)
    if not len(steps):
        return {"samples": len(time), "rate_hz": 0.0, "gap_s": 0.0, "jitter_ms": 0.0}
    middle = float(np.median(steps)) or abs(float(steps.mean()))
    spread = 1.4826e3 * float(np.median(np.abs(steps - middle)))
    return {
        "samples": len(time),
        "rate_hz": round(1 / middle, 3) if middle else 0.0,
        "gap_s": round(float(steps.max()), 4),
        "jitter_ms": round(spread, 3),
    }


def _span(values: Floats) -> list[float] | None:
    return [round(float(values.min()), 4), round(float(values.max()), 4)] if len(values) else None


def _estimates(report: Report) -> Mapping[str, dict[str, float]]:
    """What Doppler measured, by radar and for MOTION, with one sigma each."""
    errors, weighed = report.judgement.errors, report.judgement.weighed
    if errors is None or weighed is None:
        return {}
    told: dict[str, dict[str, float]] = {
        MOTION: {
            "scale": round(1 + errors.scale.value, 5),
            "scale_sigma": round(errors.scale.sigma, 5),
            "bias_deg_s": round(float(np.degrees(errors.bias.value)), 4),
            "bias_sigma_deg_s": round(float(np.degrees(errors.bias.sigma)), 4),
        }
    }
    names = [radar.name for radar in report.judgement.judged]
    for name, one in zip(names, errors.radars, strict=True):
        told[name] = {
            "yaw_off_deg": round(float(np.degrees(one.yaw.value)), 3),
            "yaw_sigma_deg": round(float(np.degrees(one.yaw.sigma)), 3),
            "offset_ms": round(one.offset.value * 1e3, 2),
            "offset_sigma_ms": round(one.offset.sigma * 1e3, 2),
            "range_rate_bias_m_s": round(one.rate_bias.value, 4),
            "spread_m_s": round(one.spread, 4),
        }
    return told


def _others(listener: Listener, most: int) -> list[tuple[tuple[str, tuple[int, bool]], int]]:
    """Ids that nothing reads, most frequent first."""
    on_bus = {channel: bus for bus, names in listener.channels.items() for channel in names}
    read_ids = listener.reader.readers
    unread = [(key, count) for key, count in listener.heard.most_common() if (on_bus.get(key[0], ""), key[1]) not in read_ids]
    return unread[:most]


def render(report: Report, title: str) -> str:
    """The report as lines of text; `title`: what was checked."""
    health, recorded = report.listener.health, report.recorded
    lines = [f"{health.frames} frames in {report.times.seconds:.1f} s, {health.unknown_frames} of other ids, "]
    lines[0] += f"{health.bad_frames} bad, {health.lost_frames} missing by their counters"
    if beside := report.account.summary():
        lines.append(f"not data frames: {beside}")
    lines += report.account.notes + report.times.notes() + remarks(report.listener.config)
    row = "{:<14}{:>9}{:>9}{:>10}{:>10}{:>12}{:>10}{:>9}{:>12}   {}".format
    lines.append(row("", "rate", "complete", "gap", "jitter", "incomplete", "repeated", "bad crc", "detections", "values"))

    def timed(name: str, time: Floats, *rest: object) -> str:
        told = _timing(time)
        gap, jitter = f"{told['gap_s'] * 1e3:.0f} ms", f"{told['jitter_ms']:.1f} ms"
        return row(name, f"{told['rate_hz']:.1f} Hz", int(told["samples"]), gap, jitter, *rest)

    for name, track, unit in ((SPEED, recorded.speed, "m/s"), (YAW_RATE, recorded.yaw_rate, "rad/s")):
        span = _span(track.value)
        lines.append(timed(name, track.time, "", "", "", "", "" if span is None else f"{span[0]:.2f} … {span[1]:.2f} {unit}"))
    for radar in recorded.radars:
        counts = health.sensors[radar.name]
        median = f"{np.median(radar.counts):.0f}" if len(radar) else "-"
        span = _span(radar.range_rate)
        values = "" if span is None else f"{span[0]:.1f} … {span[1]:.1f} m/s"
        lines.append(timed(radar.name, radar.time, counts.incomplete, counts.repeated, counts.bad_crc, median, values))
    others = _others(report.listener, 6)
    if others:
        most = ", ".join(f"{channel} 0x{number:X} ({count})" for (channel, (number, _)), count in others)
        lines.append(f"other ids, most frequent first: {most}")
    for name, told in _estimates(report).items():
        if name == MOTION:
            lines.append(
                f"by Doppler, speed x {told['scale']:.4f} ± {told['scale_sigma']:.4f}, "
                f"yaw-rate bias {told['bias_deg_s']:+.2f} ± {told['bias_sigma_deg_s']:.2f} °/s"
            )
        else:
            lines.append(
                f"by Doppler, {name}: yaw {told['yaw_off_deg']:+.2f} ± {told['yaw_sigma_deg']:.2f}°, "
                f"offset {told['offset_ms']:+.0f} ± {told['offset_sigma_ms']:.0f} ms"
            )
    if any(finding.code in ("motion_missing", "radar_missing", "pose_missing") for finding in report.findings):
        lines += report.traffic.strangers()
    lines.append("")
    for finding, fixes in said(report):
        lines.append(f"[{finding.code}] {finding.sentence} ({finding.confidence:.0%} sure; {finding.rests_on})")
        lines += [f"    mend: {line}" for line in fixes]
    lines += [f"not judged [{one.code}]: {one.sentence}" for one in report.judgement.undecided]
    sound = "nothing else wrong was found" if report.torn is not None or report.faults() else "nothing wrong was found"
    count = len(report.findings)
    lines.append(f"{title}: " + (f"{count} {'mistake' if count == 1 else 'mistakes'} found" if count else sound))
    return "\n".join(lines)
