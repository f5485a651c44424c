"""Scans and ego motion as the CAN frames of our own DBC files, with the timing of a real bus.

Encoded by cantools, which shares nothing with the service's decoder. Detections that a signal cannot hold are left out and counted; of the
others, the 64 nearest are sent, nearest first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import can
import cantools
import fastcrc
import numpy as np
from cantools.database.can import Message as DbcMessage
from cantools.database.can import Signal
from echogrid.core.messages import Floats, RadarScan
from echogrid.errors import EchogridError
from echogrid.io.profile import shipped
from numpy.typing import NDArray

from echogrid_training.bus import Request, arbitrate, frame_us, share_out
from echogrid_training.recording import Motion, Recording, Track, untracked

MAX_DETECTIONS = 64  # per radar and cycle
AGE_LSB_US = 100
AGES_LSB = (280, 320)  # 30 ± 2 ms between a measurement and its header, where the bus is free
QUALITY = 31  # the highest: the sources have no quality in common
WHEELS = ("RL", "RR", "FL", "FR")

Raw = NDArray[np.int64]


@dataclass(slots=True)
class Report:
    """What became of a recording's content on the bus."""

    cycles: int = 0
    sent: int = 0  # detections
    unencodable: int = 0  # detections with a value that no signal can hold, or none
    beyond_nearest: int = 0  # detections left out since 64 nearer ones were there
    invalid_motion: int = 0  # wheel speeds and yaw rates sent as invalid, since no signal can hold them
    frames: int = 0
    loads: dict[str, float] = field(default_factory=dict)  # share of each bus's time


class RadarLayout:
    """One of our two corner-radar layouts: a header, then the detections, CAN FD or classic."""

    def __init__(self, fd: bool) -> None:
        self.fd = fd
        self.profile = "corner_radar" if fd else "corner_radar_classic"
        self.id_step = 0x10 if fd else 0x80  # between the radars of one bus
        database = cantools.database.load_file(shipped() / f"{self.profile}.dbc")
        self.header = database.get_message_by_name("RadarHeader")
        self.pages = (
            [database.get_message_by_name("RadarDetections")] * 8
            if fd
            else [database.get_message_by_name(f"RadarDetection_{number:02d}") for number in range(1, MAX_DETECTIONS + 1)]
        )
        self.per_page = MAX_DETECTIONS // len(self.pages)
        suffix = "_1" if fd else ""
        self.quantities = [self.pages[0].get_signal_by_name(name + suffix) for name in ("Range", "Azimuth", "RangeRate", "Rcs")]

    def crc(self, data: bytes) -> int:
        """Over the header without its CRC's bytes, then the detection frames in order."""
        return fastcrc.crc32.iso_hdlc(data) if self.fd else fastcrc.crc16.ibm_3740(data)


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """One measurement cycle in the raw values of its signals."""

    stamp_us: int
    due_us: int  # when its header is to be on the bus
    detections: Raw  # (N, 4) range, azimuth, range rate, RCS; nearest first
    ambiguity: int
    blockage: int


def quantise(signal: Signal, values: Floats) -> tuple[Raw, NDArray[np.bool_]]:
    """The raw values (N,) nearest to physical ones in the DBC's unit, and which of them the signal can hold; the others are 0."""
    steps = np.round((values - float(signal.offset)) / float(signal.scale))
    if signal.is_signed:
        low, high = -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    else:
        low, high = 0, (1 << signal.length) - 1
    fits = (steps >= low) & (steps <= high)  # False for NaN
    return np.where(fits, steps, 0.0).astype(np.int64), fits


def nearest(layout: RadarLayout, scan: RadarScan, report: Report) -> Raw:
    """(N, 4) raw range, azimuth, range rate and RCS of the detections that are sent, nearest first, those of equal range in their order."""
    values = (scan.range, scan.azimuth, scan.range_rate, scan.rcs)
    columns, fit = zip(*(quantise(signal, value) for signal, value in zip(layout.quantities, values, strict=True)), strict=True)
    fits = np.logical_and.reduce(fit)
    order = np.argsort(scan.range[fits], kind="stable")
    kept = np.stack(columns, axis=-1)[fits][order[:MAX_DETECTIONS]]
    report.cycles += 1
    report.unencodable += int(np.count_nonzero(~fits))
    report.beyond_nearest += len(order) - len(kept)
    report.sent += len(kept)
    return kept


def cycles_of(layout: RadarLayout, scans: Sequence[RadarScan], rng: np.random.Generator, report: Report) -> list[Cycle]:
    """One radar's cycles in the order of time."""
    cycles = []
    for scan in sorted(scans, key=lambda scan: scan.stamp_ns):
        stamp_us = round(scan.stamp_ns / 1000)
        due_us = stamp_us + AGE_LSB_US * int(rng.integers(AGES_LSB[0], AGES_LSB[1] + 1))
        ambiguity = _header_value(layout, scan, "AmbiguityInterval", scan.ambiguity)
        blockage = _header_value(layout, scan, "Blockage", 100 * scan.blockage)
        cycles.append(Cycle(stamp_us, due_us, nearest(layout, scan, report), ambiguity, blockage))
    return cycles


def _header_value(layout: RadarLayout, scan: RadarScan, name: str, value: float) -> int:
    signal = layout.header.get_signal_by_name(name)
    raw, fits = quantise(signal, np.array([value]))
    if not fits[0]:
        raise EchogridError(
            f"radar '{scan.sensor}': {name} is {value:g} {signal.unit}, but {layout.profile}.dbc reaches only to {signal.maximum} {signal.unit}"
        )
    return int(raw[0])


def radar_requests(layout: RadarLayout, id_offset: int, cycles: Sequence[Cycle]) -> list[Request]:
    """The frames of a radar. A header waits for a time at which the measurement's age is a whole number of its signal's steps."""
    header_us = frame_us(layout.header.length, layout.fd)
    page_us = frame_us(layout.pages[0].length, layout.fd)
    requests = []
    for cycle in cycles:
        requests.append(Request(layout.header.frame_id + id_offset, header_us, cycle.due_us, AGE_LSB_US))
        requests += [Request(page.frame_id + id_offset, page_us, cycle.due_us) for page in _pages(layout, cycle)]
    return requests


def _pages(layout: RadarLayout, cycle: Cycle) -> list[DbcMessage]:
    return layout.pages[: -(-len(cycle.detections) // layout.per_page)]


def radar_frames(layout: RadarLayout, id_offset: int, cycle: Cycle, counter: int, ends_us: Sequence[int]) -> list[can.Message]:
    """The frames of one cycle, header first; `ends_us` is when each of them ends."""
    age, rest = divmod(ends_us[0] - cycle.stamp_us, AGE_LSB_US)
    assert rest == 0
    longest = (1 << layout.header.get_signal_by_name("MeasurementAge").length) - 1
    if age > longest:
        raise EchogridError(f"a header would be sent {age / 10:g} ms after its measurement, but {layout.profile}.dbc ends at {longest / 10:g} ms")
    pages = [_page_payload(layout, cycle, number, counter) for number in range(len(ends_us) - 1)]
    header = {
        "CycleCounter": counter % 256,
        "DetectionCount": len(cycle.detections),
        "MeasurementAge": age,
        "AmbiguityInterval": cycle.ambiguity,
        "Blockage": cycle.blockage,
        "Crc": 0,
    }
    payload = _sealed(layout.header, header, layout, b"".join(pages))
    frames = [_message(layout.header.frame_id + id_offset, payload, ends_us[0], layout.fd)]
    for page, data, end_us in zip(_pages(layout, cycle), pages, ends_us[1:], strict=True):
        frames.append(_message(page.frame_id + id_offset, data, end_us, layout.fd))
    return frames


def _page_payload(layout: RadarLayout, cycle: Cycle, number: int, counter: int) -> bytes:
    message = layout.pages[number]
    signals = dict.fromkeys((signal.name for signal in message.signals), 0)
    signals["CycleCounter"] = counter % 256
    if layout.fd:
        signals["Page"] = number
    chunk = cycle.detections[number * layout.per_page : (number + 1) * layout.per_page].tolist()
    for k, (range_, azimuth, range_rate, rcs) in enumerate(chunk, start=1):
        end = f"_{k}" if layout.fd else ""
        signals |= {f"Range{end}": range_, f"Azimuth{end}": azimuth, f"RangeRate{end}": range_rate, f"Rcs{end}": rcs}
        signals |= {f"Quality{end}": QUALITY, f"Valid{end}": 1}
    return message.encode(signals, scaling=False, strict=False)


def _sealed(message: DbcMessage, signals: dict[str, int], layout: RadarLayout | None = None, summed: bytes = b"") -> bytes:
    """The payload with its CRC over its other bytes and `summed`; without a radar layout it is that of the motion frames."""
    payload = message.encode(signals, scaling=False, strict=False)
    place = message.get_signal_by_name("Crc")
    first, count = place.start // 8, place.length // 8
    others = payload[:first] + payload[first + count :] + summed
    crc = fastcrc.crc8.sae_j1850(others) if layout is None else layout.crc(others)
    return payload[:first] + crc.to_bytes(count, "little") + payload[first + count :]


def _message(can_id: int, data: bytes, end_us: int, fd: bool) -> can.Message:
    return can.Message(
        timestamp=end_us / 1e6, arbitration_id=can_id, is_extended_id=False, is_fd=fd, bitrate_switch=fd, data=data, dlc=len(data)
    )


class MotionWriter:
    """The three messages of vehicle_motion.dbc, always classic frames."""

    def __init__(self, motion: Motion, report: Report) -> None:
        database = cantools.database.load_file(shipped() / "vehicle_motion.dbc")
        rear = database.get_message_by_name("WheelSpeedsRear")
        front = database.get_message_by_name("WheelSpeedsFront")
        yaw = database.get_message_by_name("YawRate")
        rear_speed = motion.wheel_speed[:, :2].mean(axis=1)
        direction = np.where(rear_speed > 0, 1, np.where(rear_speed < 0, 2, 0))  # 0, unknown, where it stands or shows nothing
        wheels: dict[str, tuple[Raw, NDArray[np.bool_]]] = {}
        for wheel, speed in zip(WHEELS, motion.wheel_speed.T, strict=True):
            message = rear if wheel in ("RL", "RR") else front
            wheels[wheel] = quantise(message.get_signal_by_name(f"WheelSpeed{wheel}"), np.abs(speed))
        yaw_rate = quantise(yaw.get_signal_by_name("YawRate"), motion.yaw_rate)
        report.invalid_motion += sum(int(np.count_nonzero(~fits)) for _, fits in (*wheels.values(), yaw_rate))
        self.messages = (rear, front, yaw)
        self.stamps_ns = (motion.wheel_stamp_ns, motion.wheel_stamp_ns, motion.yaw_stamp_ns)
        self.signals: tuple[list[dict[str, int]], ...] = (
            [_wheels(index, wheels, ("RL", "RR")) | {"DirectionOfTravel": int(way)} for index, way in enumerate(direction)],
            [_wheels(index, wheels, ("FL", "FR")) for index in range(len(direction))],
            [{"YawRate": int(raw), "YawRateValid": int(fits)} for raw, fits in zip(*yaw_rate, strict=True)],
        )

    def requests(self) -> list[list[Request]]:
        """One sender for each message: a frame ends at the time of its sample, or once the bus is free."""
        return [
            [Request(message.frame_id, frame_us(message.length, fd=False), stamp_us) for stamp_us in _whole_us(stamps)]
            for message, stamps in zip(self.messages, self.stamps_ns, strict=True)
        ]

    def frames(self, ends_us: Sequence[Sequence[int]]) -> list[can.Message]:
        """All frames; `ends_us` as `arbitrate` gave them for `requests`."""
        return [
            _message(message.frame_id, _sealed(message, values | {"Counter": count % 16, "Crc": 0}), end_us, fd=False)
            for message, signals, ends in zip(self.messages, self.signals, ends_us, strict=True)
            for count, (values, end_us) in enumerate(zip(signals, ends, strict=True))
        ]


def _wheels(index: int, wheels: dict[str, tuple[Raw, NDArray[np.bool_]]], names: tuple[str, str]) -> dict[str, int]:
    raw = {f"WheelSpeed{name}": int(wheels[name][0][index]) for name in names}
    return raw | {f"WheelSpeed{name}Valid": int(wheels[name][1][index]) for name in names}


def _whole_us(stamp_ns: NDArray[np.int64]) -> list[int]:
    return [round(stamp / 1000) for stamp in stamp_ns.tolist()]


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
    cycles = {
        radar.name: cycles_of(layout, [scan for scan in recording.scans if scan.sensor == radar.name], rng, report)
        for radar in recording.radars
    }
    wirings, loads = wire(layout, cycles, motion)
    report.loads = {f"can{number}": load for number, load in enumerate(loads)}
    messages: list[can.Message] = []
    for bus in range(len(loads)):
        names = [name for name, wiring in wirings.items() if wiring.bus == bus]
        senders = [radar_requests(layout, wirings[name].id_offset, cycles[name]) for name in names]
        first = len(messages)
        ends = arbitrate([*senders, *(motion.requests() if bus == 0 else [])])
        for name, times in zip(names, ends, strict=False):
            at = 0
            for counter, cycle in enumerate(track(cycles[name], f"{name} onto can{bus}")):
                count = 1 + len(_pages(layout, cycle))
                messages += radar_frames(layout, wirings[name].id_offset, cycle, counter, times[at : at + count])
                at += count
        if bus == 0:
            messages += motion.frames(ends[len(names) :])
        for message in messages[first:]:
            message.channel = f"can{bus}"
    report.frames = len(messages)
    return sorted(messages, key=lambda message: message.timestamp), wirings, report


def wire(layout: RadarLayout, cycles: dict[str, list[Cycle]], motion: MotionWriter) -> tuple[dict[str, Wiring], list[float]]:
    """Spreads the radars over as few buses as their traffic allows. Returns the wiring and the load of each bus."""
    radars = {name: radar_requests(layout, 0, of_radar) for name, of_radar in cycles.items()}
    others = motion.requests()
    due_us = [request.due_us for requests in (*radars.values(), *others) for request in requests]
    span_us = max(due_us) - min(due_us)
    loads = [sum(request.duration_us for request in requests) / span_us for requests in radars.values()]
    motion_load = sum(request.duration_us for requests in others for request in requests) / span_us
    buses = share_out(motion_load, loads)
    wirings = {
        name: Wiring(bus, layout.id_step * buses[:index].count(bus)) for index, (name, bus) in enumerate(zip(radars, buses, strict=True))
    }
    per_bus = [motion_load, *[0.0] * max(buses)]
    for bus, load in zip(buses, loads, strict=True):
        per_bus[bus] += load
    return wirings, per_bus
