"""The running service on an endless drive, as fast as it keeps up, and what becomes of memory, latency and counters."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from typing import Any

import msgspec

from echogrid.commands.demo import on_a_free_port
from echogrid.config.loading import load_config
from echogrid.live.player import AHEAD_FRAMES, on_virtual_buses, senders
from echogrid.live.service import Service
from echogrid.pipeline import Pipeline
from tests.endurance.chart import Curve, chart
from tests.endurance.loop import EndlessDrive

SAMPLE = 5.0  # s
MIB = 64  # of tiles in memory: filled within the warm-up
COUNTED = ("cycles", "lost_frames", "motion_dropped", "dropped_frames", "dropped_motion", "bad_frames", "epoch")


def soak(drive: Path, out: Path, minutes: float, model: str | None = None) -> dict[str, Any]:
    """Writes soak.json and soak.svg into `out`; returns the summary."""
    source = drive / "echogrid.toml"
    config = on_a_free_port(on_virtual_buses(load_config(source, model)))
    out.mkdir(parents=True, exist_ok=True)
    path = out / "soak.egmap"
    for old in out.glob(f"{path.name}*"):
        old.unlink()
    bounds = msgspec.structs.replace(config.map, max_mib=MIB)
    config = msgspec.structs.replace(config, map=bounds, store=msgspec.structs.replace(config.store, path=str(path)))
    service = Service(Pipeline(config, source))
    endless = EndlessDrive(drive / "can.log.gz", config, source)
    samples: list[dict[str, float]] = []
    workers = [
        threading.Thread(target=_play, args=(service, endless), name="player"),
        threading.Thread(target=_sample, args=(service, samples, minutes * 60), name="sampler"),
    ]
    for worker in workers:
        worker.start()
    service.run()
    for worker in workers:
        worker.join()
    summary = summarise(samples, endless.lap_s)
    (out / "soak.json").write_text(json.dumps({"summary": summary, "samples": samples}, indent=1) + "\n")
    (out / "soak.svg").write_text(draw(samples))
    return summary


def summarise(samples: list[dict[str, float]], lap_s: float) -> dict[str, Any]:
    """Of what came after the warm-up: the first third."""
    late = samples[len(samples) // 3 :]
    memory = [sample["rss_mib"] for sample in late]
    latency = [sample["latency_p99_ms"] for sample in late]
    half = len(late) // 2
    last = samples[-1]
    return {
        "wall_min": last["wall_s"] / 60,
        "driven_h": last["driven_s"] / 3600,
        "laps": last["driven_s"] / lap_s,
        "driven_km": last["distance_m"] / 1000,
        "times_real_time": last["driven_s"] / last["wall_s"],
        "map_updates": last["cycles"],
        "rss_mib": [min(memory), max(memory)],
        "rss_swing": (max(memory) - min(memory)) / (max(memory) + min(memory)),  # each way from the middle
        "latency_p99_ms_halves": [sum(latency[:half]) / max(half, 1), sum(latency[half:]) / max(len(latency) - half, 1)],
        **{
            key: last[key]
            for key in ("lost_frames", "motion_dropped", "dropped_frames", "dropped_motion", "bad_frames", "gaps", "epoch", "not_ok")
        },
    }


def draw(samples: list[dict[str, float]]) -> str:
    """SVG."""
    hours = [sample["driven_s"] / 3600 for sample in samples]
    curves = (
        Curve("resident memory, MiB", [sample["rss_mib"] for sample in samples]),
        Curve("from the receipt of a cycle's last frame to its map, ms, median of 512 updates", [s["latency_p50_ms"] for s in samples]),
        Curve("the same, 99th percentile", [sample["latency_p99_ms"] for sample in samples]),
        Curve("tiles in memory", [sample["tiles"] for sample in samples]),
        Curve("map on the disk, MiB", [sample["stored_mib"] for sample in samples]),
        Curve(
            "ego motion lost, frames", [sample["lost_frames"] + sample["motion_dropped"] + sample["dropped_motion"] for sample in samples]
        ),
    )
    return chart(hours, "hours of driving", curves)


def _play(service: Service, endless: EndlessDrive) -> None:
    service.live.wait(60.0)
    buses = senders(service.config)
    try:
        for sent, (bus, message) in enumerate(endless):
            if service.workers.stop.is_set():
                return
            buses[bus].send(message)
            while sent - service.pipeline.health.frames > AHEAD_FRAMES and not service.workers.stop.is_set():
                time.sleep(0.001)
    finally:
        for opened in buses.values():
            opened.shutdown()


def _sample(service: Service, samples: list[dict[str, float]], seconds: float) -> None:
    service.live.wait(60.0)
    started, not_ok = time.monotonic(), 0
    while (wall := time.monotonic() - started) < seconds and not service.workers.stop.wait(SAMPLE):
        status, mapper, signals = service.status(), service.pipeline.mapper, service.pipeline.signals
        latency = status["latency_ms"]
        if signals.time.newest_ns is None or latency["p50"] is None:
            continue
        first_ns = samples[0]["stamp_s"] if samples else signals.time.newest_ns * 1e-9
        not_ok += status["state"] != "ok"
        samples.append(
            {
                "wall_s": wall,
                "stamp_s": signals.time.newest_ns * 1e-9,
                "driven_s": signals.time.newest_ns * 1e-9 - first_ns,
                "distance_m": mapper.odometry.distance,
                "rss_mib": status["rss_mib"],
                "latency_p50_ms": latency["p50"],
                "latency_p99_ms": latency["p99"],
                "tiles": len(mapper.map.tiles),
                "gaps": mapper.odometry.gaps,
                "not_ok": not_ok,
                "stored_mib": status["store"]["mib"],
                **{key: status[key] for key in COUNTED},
            }
        )
    service.workers.stop.set()
