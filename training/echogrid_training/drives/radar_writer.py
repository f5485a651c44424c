"""Scans of one radar as the frames of our two corner-radar layouts.

Detections that a signal cannot hold are left out and counted; of the others, the 64 nearest are sent, nearest first.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import can
import fastcrc
import numpy as np
from cantools.database.can import Message as DbcMessage

from echogrid.core.messages import RadarScan
from echogrid.errors import EchogridError
from echogrid_training.drives.bus import Request, frame_us
from echogrid_training.drives.frames import Raw, Report, frame, load_dbc, quantise, sealed
from echogrid_training.recording import Track

MAX_DETECTIONS = 64  # per radar and cycle
AGE_LSB_US = 100
AGES_LSB = (280, 320)  # 30 ± 2 ms between a measurement and its header, where the bus is free
QUALITY = 31  # the highest: the sources have no quality in common


class RadarLayout:
    """One of our two corner-radar layouts: a header, then the detections, CAN FD or classic."""

    def __init__(self, fd: bool) -> None:
        self.fd = fd
        self.profile = "corner_radar" if fd else "corner_radar_classic"
        self.id_step = 0x10 if fd else 0x80  # between the radars of one bus
        database = load_dbc(self.profile)
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

    def pages_of(self, detections: int) -> list[DbcMessage]:
        """The messages of a cycle's detection frames."""
        return self.pages[: -(-detections // self.per_page)]


@dataclass(frozen=True, slots=True, eq=False)
class Cycle:
    """One measurement cycle in the raw values of its signals."""

    stamp_us: int
    due_us: int  # when its header is to be on the bus
    detections: Raw  # (N, 4) range, azimuth, range rate, RCS; nearest first
    ambiguity: int
    blockage: int


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


class RadarWriter:
    """One radar's cycles in the order of time, numbered from 0."""

    def __init__(self, name: str, layout: RadarLayout, scans: Iterable[RadarScan], rng: np.random.Generator, report: Report) -> None:
        """`rng` draws how long the radar takes to work out each scan."""
        self.name = name
        self.layout = layout
        self.cycles: list[Cycle] = []
        for scan in sorted(scans, key=lambda scan: scan.stamp_ns):
            stamp_us = round(scan.stamp_ns / 1000)
            due_us = stamp_us + AGE_LSB_US * int(rng.integers(AGES_LSB[0], AGES_LSB[1] + 1))
            ambiguity = self._header_value("AmbiguityInterval", scan.ambiguity)
            blockage = self._header_value("Blockage", 100 * scan.blockage)
            self.cycles.append(Cycle(stamp_us, due_us, nearest(layout, scan, report), ambiguity, blockage))

    def _header_value(self, name: str, value: float) -> int:
        signal = self.layout.header.get_signal_by_name(name)
        raw, fits = quantise(signal, np.array([value]))
        if not fits[0]:
            file = f"{self.layout.profile}.dbc"
            raise EchogridError(
                f"radar '{self.name}': {name} is {value:g} {signal.unit}, but {file} ends at {signal.maximum} {signal.unit}"
            )
        return int(raw[0])

    def requests(self, id_offset: int = 0) -> list[Request]:
        """Its frames. A header waits for a time at which the measurement's age is a whole number of its signal's steps."""
        layout, requests = self.layout, []
        header_us, page_us = (frame_us(message.length, layout.fd) for message in (layout.header, layout.pages[0]))
        for cycle in self.cycles:
            requests.append(Request(layout.header.frame_id + id_offset, header_us, cycle.due_us, AGE_LSB_US))
            pages = layout.pages_of(len(cycle.detections))
            requests += [Request(page.frame_id + id_offset, page_us, cycle.due_us) for page in pages]
        return requests

    def frames(self, ends_us: Iterable[int], id_offset: int, track: Track) -> list[can.Message]:
        """All frames; `ends_us` as `arbitrate` gave them for `requests`."""
        frames: list[can.Message] = []
        ends = iter(ends_us)
        for number, cycle in enumerate(track(self.cycles, f"writing {self.name}")):
            header_end_us = next(ends)
            pages = [(page, self._page(cycle, slot, number % 256)) for slot, page in enumerate(self.layout.pages_of(len(cycle.detections)))]
            header = self._header(cycle, number % 256, header_end_us, b"".join(payload for _, payload in pages))
            frames.append(frame(self.layout.header.frame_id + id_offset, header, header_end_us, self.layout.fd))
            frames += [frame(page.frame_id + id_offset, payload, next(ends), self.layout.fd) for page, payload in pages]
        return frames

    def _header(self, cycle: Cycle, counter: int, end_us: int, pages: bytes) -> bytes:
        layout = self.layout
        age, longest = (end_us - cycle.stamp_us) // AGE_LSB_US, (1 << layout.header.get_signal_by_name("MeasurementAge").length) - 1
        if age > longest:
            found, most = (f"{AGE_LSB_US * steps / 1000:g} ms" for steps in (age, longest))
            raise EchogridError(
                f"radar '{self.name}': a header is sent {found} after its measurement, but in {layout.profile}.dbc the age ends at {most}"
            )
        values = {"CycleCounter": counter, "DetectionCount": len(cycle.detections), "MeasurementAge": age}
        values |= {"AmbiguityInterval": cycle.ambiguity, "Blockage": cycle.blockage}
        return sealed(layout.header, values, layout.crc, pages)

    def _page(self, cycle: Cycle, slot: int, counter: int) -> bytes:
        layout, message = self.layout, self.layout.pages[slot]
        signals = dict.fromkeys((signal.name for signal in message.signals), 0)
        signals["CycleCounter"] = counter
        if layout.fd:
            signals["Page"] = slot
        chunk = cycle.detections[slot * layout.per_page : (slot + 1) * layout.per_page].tolist()
        for k, (range_, azimuth, range_rate, rcs) in enumerate(chunk, start=1):
            end = f"_{k}" if layout.fd else ""
            signals |= {f"Range{end}": range_, f"Azimuth{end}": azimuth, f"RangeRate{end}": range_rate, f"Rcs{end}": rcs}
            signals |= {f"Quality{end}": QUALITY, f"Valid{end}": 1}
        return message.encode(signals, scaling=False, strict=False)
