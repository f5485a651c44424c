"""What a running service says of itself, as lines for a terminal."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from echogrid.errors import EchogridError

Line = list[tuple[str, str]]  # pieces of text, each with its style in rich's words, "" for none
STYLES = {"ok": "bold green", "degraded": "bold yellow"}  # any other state is bold red


class File(msgspec.Struct, frozen=True, kw_only=True):
    """What the service writes."""

    state: str
    reason: str = ""
    mib: float | None = None


class Placed(msgspec.Struct, frozen=True, kw_only=True):
    """The poses from outside."""

    state: str
    reason: str = ""
    map_from_odom: dict[str, float] | None = None
    taken: int = 0


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """What is shown of a status. Another version of the service may send more or less of it."""

    state: str
    reasons: tuple[str, ...] = ()
    epoch: int | None = None
    model: str = "unknown"
    kernels: str = "unknown"
    rates: dict[str, float] = {}
    latency_ms: dict[str, float | None] = {}
    rss_mib: float | None = None
    store: File | None = None
    recording: File | None = None
    learned: dict[str, float] = {}
    pose: Placed | None = None
    sensors: dict[str, dict[str, Any]] = {}
    buses: dict[str, dict[str, Any]] = {}
    counters: dict[str, int] = {}  # all other whole numbers


def lines(document: Mapping[str, Any], vehicle: str) -> list[Line]:
    """A status for people. Raises EchogridError if it is not a status."""
    counters = {key: value for key, value in document.items() if type(value) is int and key != "epoch"}
    try:
        status = msgspec.convert({**document, "counters": counters}, Status)
    except msgspec.ValidationError as error:
        raise EchogridError(f"vehicle '{vehicle}': this version of echogrid cannot read the status: {error}") from error
    style = STYLES.get(status.state, "bold red")
    rates, latency = status.rates, status.latency_ms
    result: list[Line] = [
        [(vehicle, "bold"), (" is ", ""), (status.state, style)],
        *([(f"  {reason}", style.removeprefix("bold "))] for reason in status.reasons),
        _line("map", f"{_number(rates.get('map_hz'), 1)} updates/s, epoch {_number(status.epoch)}"),
        _line("traffic", f"{_number(rates.get('frames_hz'))} frames/s"),
        _line("latency", f"{_number(latency.get('p50'), 1)} ms, 99 % within {_number(latency.get('p99'), 1)} ms"),
        _line("memory", f"{_number(status.rss_mib)} MiB"),
        *_file("store", status.store),
        *_file("recording", status.recording),
        _line("model", status.model),
        _line("kernels", status.kernels),
        *_learned(status.learned),
        *_placed(status.pose),
        *_parts("radar", status.sensors, status.reasons),
        *_parts("bus", status.buses, status.reasons),
        _line("counters", _counts(status.counters)),
    ]
    return [[(_printable(text), style) for text, style in line] for line in result]


def as_json(document: Mapping[str, Any], vehicle: str) -> list[Line]:
    """A status for programs: one line."""
    return [[(json.dumps(document), "")]]


def silence(vehicle: str, seconds: float) -> list[Line]:
    """Instead of a status that is too old to be shown."""
    return [[(vehicle, "bold"), (" does not answer", "bold red"), (f", for {seconds:.0f} s now", "")]]


def _file(label: str, file: File | None) -> Iterator[Line]:
    """Nothing if there is none; yellow if it is not written."""
    if file is not None:
        style = "" if file.state in ("ok", "recording", "closed") else "yellow"
        yield [(f"{label:10}", "dim"), (f"{file.state}, {_number(file.mib)} MiB" + (f": {file.reason}" if file.reason else ""), style)]


def _parts(kind: str, parts: Mapping[str, Mapping[str, Any]], reasons: tuple[str, ...]) -> Iterator[Line]:
    """A line for each radar or bus: yellow where a reason names it, red where it is down."""
    width = max(map(len, parts), default=0)
    for name, counters in parts.items():
        up = counters.get("up", True)
        said = any(reason.startswith(f"{kind} {name}: ") for reason in reasons)
        style = "red" if not up else "yellow" if said else ""
        yield [(f"{kind:10}", "dim"), (f"{name:{width}}  ", style), ("" if up else "down, ", style), (_counts(counters), style)]


def _learned(learned: Mapping[str, float]) -> Iterator[Line]:
    """What ego motion is off by, with one sigma."""
    for key, label, unit in (("wheel_scale_percent", "wheels", " %"), ("yaw_rate_bias_deg_s", "yaw rate", " °/s")):
        if key in learned:
            sigma, applied = (_number(learned.get(f"{key}_{what}"), 2) for what in ("sigma", "applied"))
            yield _line(label, f"{learned[key]:+.2f} ±{sigma}{unit}, of which {applied} is corrected")


def _placed(pose: Placed | None) -> Iterator[Line]:
    """Where odom lies by them; yellow if they are not well."""
    if pose is not None:
        at = {} if pose.map_from_odom is None else pose.map_from_odom
        where = f", odom at {_number(at.get('x'), 2)}, {_number(at.get('y'), 2)} m, {_number(at.get('yaw_deg'), 2)}°" if at else ""
        text = pose.state + (f": {pose.reason}" if pose.reason else "") + f"{where}, {pose.taken:,} taken"
        yield [(f"{'pose':10}", "dim"), (text, "" if pose.state == "ok" else "yellow")]


def _line(label: str, text: str) -> Line:
    return [(f"{label:10}", "dim"), (text, "")]


def _counts(counters: Mapping[str, Any]) -> str:
    """The first counter, and all others that are not 0."""
    counts = [(key, value) for key, value in counters.items() if type(value) is int]
    return ", ".join(f"{value:,} {key.replace('_', ' ')}" for n, (key, value) in enumerate(counts) if value or n == 0)


def _number(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:,.{digits}f}"


def _printable(text: str) -> str:
    """What came over the network moves no cursor and rings no bell."""
    return "".join(character if character.isprintable() else "?" for character in text)
