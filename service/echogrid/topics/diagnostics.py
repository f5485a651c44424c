"""The service's status as ROS's diagnostics: level, message and numbers for the service and each of its parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from echogrid.topics.diagnostic_array import DiagnosticArray, DiagnosticStatus, Level

LEVELS = {"ok": Level.OK, "degraded": Level.WARN, "no_motion": Level.ERROR, "stale": Level.STALE, "stopped": Level.ERROR}
PROGRAM = "echogrid"  # diagnostic_aggregator groups by the text before the colon
OTHERS = ("store", "recording", "pose")  # that have a state and a reason of their own, each if configured
MOTION = ("wheel speed", "yaw rate")
OUTSIDE = ("vehicle", "publish.connect")  # a namesake, a router that is not there: in `ok` too, for the map is right


def diagnostics(status: Mapping[str, Any], vehicle: str, stamp_ns: int) -> DiagnosticArray:
    """`status` is what the service publishes under that name, see docs/watching.md; `stamp_ns`: when it was taken, in Unix time."""
    state, reasons = status["state"], status["reasons"]
    own = {key: value for key, value in status.items() if key not in ("state", "reasons", *OTHERS, "sensors", "buses")}
    level = Level.WARN if state == "ok" and any(about(part, reasons) for part in OUTSIDE) else LEVELS[state]
    service = DiagnosticStatus(level, f"{PROGRAM}: service", "; ".join((state, *reasons)), vehicle, _texts(own))
    said = [f"{name}: {what}" for name in MOTION for what in about(name, reasons)]
    parts = [_part("motion", vehicle, state, said, Level.ERROR if state == "no_motion" else Level.WARN, {})]
    for name in OTHERS:
        other = status.get(name)  # a replay writes no files
        if other is not None:
            said = [f"{other['state']}: {other['reason']}"] if other["reason"] else []
            parts.append(_part(name, vehicle, state, said, Level.WARN, other))
    for name, counters in status["sensors"].items():
        parts.append(_part(f"radar {name}", name, state, about(f"radar {name}", reasons), Level.WARN, counters))
    for name, bus in status["buses"].items():
        said = about(f"bus {name}", reasons) or ([] if bus["up"] else ["down"])
        parts.append(_part(f"bus {name}", name, state, said, Level.WARN if bus["up"] else Level.ERROR, bus))
    return DiagnosticArray(stamp_ns, "", (service, *parts))


def about(part: str, reasons: Iterable[str]) -> list[str]:
    """What the reasons say of one part, such as "radar front_left"; each reads "part: what"."""
    return [reason.removeprefix(f"{part}: ") for reason in reasons if reason.startswith(f"{part}: ")]


def _part(name: str, hardware_id: str, state: str, said: list[str], level: Level, values: Mapping[str, Any]) -> DiagnosticStatus:
    """`level` where something is said of it. Where not, it is as good as the map is new: of an old one no part is called ok."""
    if not said:
        level, said = (Level.STALE, [state]) if state in ("stale", "stopped") else (Level.OK, ["ok"])
    return DiagnosticStatus(level, f"{PROGRAM}: {name}", "; ".join(said), hardware_id, _texts(values))


def _texts(values: Mapping[str, Any]) -> dict[str, str]:
    """Values as texts, those of a table inside under "table.key"."""
    texts: dict[str, str] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            texts |= {f"{key}.{inner}": text for inner, text in _texts(value).items()}
        else:
            texts[key] = f"{value:.6g}" if isinstance(value, float) else str(value)
    return texts
