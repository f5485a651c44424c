"""A recording as the CAN frames of our own DBC files, with the timing of a real bus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import can
import numpy as np

from echogrid_training.drives.bus import arbitrate, share_out
from echogrid_training.drives.frames import Report
from echogrid_training.drives.motion_writer import MotionWriter
from echogrid_training.drives.radar_writer import RadarLayout, RadarWriter
from echogrid_training.recording import Recording, Track, untracked


@dataclass(frozen=True, slots=True)
class Wiring:
    """Where a radar is connected: the number of its bus (motion is on bus 0), and what is added to its ids."""

    bus: int
    id_offset: int


def can_frames(
    recording: Recording, fd: bool = True, seed: int = 0, track: Track = untracked
) -> tuple[list[can.Message], dict[str, Wiring], Report]:
    """The recording's frames on buses can0, can1 … in the order of time, how its radars are wired by name, and what became of its content.

    Frames of one bus do not overlap, and a frame's time is its end. The header's time less MeasurementAge is the scan's stamp to the µs.
    `seed` draws the radars' processing times.
    """
    layout, report, rng = RadarLayout(fd), Report(), np.random.default_rng(seed)
    motion = MotionWriter(recording.motion, report)
    radars = [
        RadarWriter(radar.name, layout, [scan for scan in recording.scans if scan.sensor == radar.name], rng, report)
        for radar in recording.radars
    ]
    wirings, report.loads = wire(radars, motion)
    messages: list[can.Message] = []
    for bus, channel in enumerate(report.loads):
        here = [(radar, wiring.id_offset) for radar, wiring in zip(radars, wirings.values(), strict=True) if wiring.bus == bus]
        requests = [radar.requests(id_offset) for radar, id_offset in here]
        ends_us = arbitrate([*requests, *(motion.requests() if bus == 0 else [])])
        frames = [radar.frames(ends, id_offset, track) for (radar, id_offset), ends in zip(here, ends_us, strict=False)]
        if bus == 0:
            frames.append(motion.frames(ends_us[len(here) :]))
        for message in chain.from_iterable(frames):
            message.channel = channel
            messages.append(message)
    report.frames = len(messages)
    return sorted(messages, key=lambda message: message.timestamp), wirings, report


def wire(radars: Sequence[RadarWriter], motion: MotionWriter) -> tuple[dict[str, Wiring], dict[str, float]]:
    """Spreads the radars over as few buses as their traffic allows. Returns each radar's wiring and each bus's load, by name."""
    of_radars, of_motion = [radar.requests() for radar in radars], list(chain.from_iterable(motion.requests()))
    due_us = [request.due_us for request in chain(of_motion, *of_radars)]
    span_us = max(due_us) - min(due_us)
    motion_load, *radar_loads = (sum(request.duration_us for request in requests) / span_us for requests in (of_motion, *of_radars))
    buses = share_out(motion_load, radar_loads)
    wirings = {
        radar.name: Wiring(bus, radar.layout.id_step * buses[:index].count(bus))
        for index, (radar, bus) in enumerate(zip(radars, buses, strict=True))
    }
    loads = {"can0": motion_load} | {f"can{number}": 0.0 for number in range(1, max(buses) + 1)}
    for bus, load in zip(buses, radar_loads, strict=True):
        loads[f"can{bus}"] += load
    return wirings, loads
