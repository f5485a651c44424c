"""A status as the service publishes it, with a different value in every place."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

from echogrid.can.bus import BusHealth
from echogrid.core.health import Health, PoseHealth, SensorHealth


def status(state: str = "ok", *reasons: str) -> dict[str, Any]:
    """Two radars, two buses; the second bus is down."""
    radars = ("front_left", "rear_right")
    sensors = {name: SensorHealth(*(100 * (n + 1) + i for i in range(len(fields(SensorHealth))))) for n, name in enumerate(radars)}
    counters = [field.name for field in fields(Health) if field.name not in ("sensors", "pose")]
    health = Health(**{name: 1000 + i for i, name in enumerate(counters)}, sensors=sensors)
    return {
        "state": state,
        "reasons": reasons,
        "epoch": 2,
        "model": 'default.onnx: "float" is\\as fast here',
        "kernels": "compiled",
        "buses": {"chassis": asdict(BusHealth(10, 11, 12, 13, 14, True)), "radars": asdict(BusHealth(20, 21, 22, 23, 24, False))},
        "rates": {"map_hz": 19.5, "frames_hz": 4120.25},
        "latency_ms": {"p50": 12.5, "p99": 31.25},
        "dropped_frames": 7,
        "store": {"state": "ok", "reason": "", "epoch": 31, "mib": 12.5, "written": 32, "failed": 33, "forgotten": 34, "removed": 35},
        "recording": {
            "file": "drive.mcap",
            "state": "failed",
            "reason": "No space left on device",
            "messages": 41,
            "frames": 42,
            "left_out": 43,
            "mib": 44.5,
        },
        "rss_mib": 143.5,
        **asdict(health),
        "pose": {
            "state": "silent",
            "reason": "none for 1.4 s",
            "map_from_odom": {"x": 51.25, "y": -52.5, "yaw_deg": 53.75},
            **asdict(PoseHealth(*range(54, 54 + len(fields(PoseHealth))))),
        },
    }
