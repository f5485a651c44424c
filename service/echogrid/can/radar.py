"""One radar's frames into scans, as its profile says."""

from __future__ import annotations

import math
from dataclasses import dataclass

import can
import numpy as np

from echogrid.can.cadence import Cadence
from echogrid.can.database import Message
from echogrid.can.dbc import Checksum, Dbc
from echogrid.can.decode import SignalLayout
from echogrid.can.profile import Detections, RadarProfile
from echogrid.can.quantity import QuantityReader, fill
from echogrid.core.health import SensorHealth
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.radar.scan import AssemblyRule, Cycle, CycleFrame, FrameKind, ScanAssembler

FrameId = tuple[int, bool]  # arbitration id, extended


@dataclass(frozen=True, slots=True)
class FrameRole:
    """What the frames of one id are in a cycle; `kind` None: they carry the measurement age alone."""

    kind: FrameKind | None
    length: int
    slot: int | None = None
    last: bool = False


class RadarReader:
    """Remembers the half-assembled cycle of one radar and the number of the last."""

    def __init__(self, sensor: str, profile: RadarProfile, dbc: Dbc, id_offset: int, health: SensorHealth, latency_ms: float = 0.0) -> None:
        """`latency_ms` is added to the profile's. Raises EchogridError where the profile names what the DBC does not have."""
        self.sensor = sensor
        self.latency = (profile.latency_ms + latency_ms) * 1e-3  # s
        self.profile = profile
        self.health = health
        self.layout = _Layout(profile, dbc)
        self.roles = self.layout.roles(id_offset)
        self.age_payload: bytes | None = None
        self.cadence = Cadence(self.layout.cycle.length) if self.layout.cycle is not None else None
        self.assembler = ScanAssembler(
            AssemblyRule(
                ends_with_message=self.layout.ends_with is not None,
                has_header=profile.header is not None,
                frames=profile.frames,
                cycle_bits=profile.detections.cycle_bits,
                timeout_ns=round(profile.timeout_ms * 1e6),
            ),
            health,
        )

    @property
    def ids(self) -> set[FrameId]:
        """The frames that are read."""
        return set(self.roles)

    def add(self, message: can.Message, received_ns: int) -> RadarScan | None:
        """The scan that this frame completes, if any. Raises ValueError for a bad frame."""
        role = self.roles[message.arbitration_id, message.is_extended_id]
        payload = bytes(message.data)[: role.length]
        if len(payload) < role.length:
            raise ValueError("too short")
        if role.kind is None:
            self.age_payload = payload
            return None
        cycle = self.assembler.add(self._frame(role, role.kind, payload, received_ns))
        return None if cycle is None else self._scan(cycle, received_ns)

    def _frame(self, role: FrameRole, kind: FrameKind, payload: bytes, received_ns: int) -> CycleFrame:
        layout = self.layout
        number = slot = expected = None
        if kind is FrameKind.HEADER:
            number = layout.cycle.raw(payload) if layout.cycle is not None else None
            if layout.counts:
                expected = math.ceil(self._count(payload) / self.profile.detections.per_frame)
        elif kind is FrameKind.DETECTIONS:
            if layout.frame_crc is not None and not layout.frame_crc.holds(payload):
                self.health.bad_crc += 1
                raise ValueError("wrong checksum")
            number = layout.detections_cycle.raw(payload) if layout.detections_cycle is not None else None
            slot = layout.page.raw(payload) if layout.page else role.slot
        return CycleFrame(kind, payload, received_ns, number, slot, expected, role.last)

    def _count(self, header: bytes) -> int:
        return sum(signal.raw(header) for signal in self.layout.counts)

    def _scan(self, cycle: Cycle, received_ns: int) -> RadarScan | None:
        frames = cycle.detection_frames()
        if self.layout.cycle_crc is not None and not self._checksum_holds(cycle, self.layout.cycle_crc):
            self.health.bad_crc += 1
            return None
        header = cycle.header
        age = self._age(cycle) + self.latency
        ambiguity, blockage = self.profile.ambiguity_interval, 0.0
        if header is not None and self.layout.header_values is not None:
            values = self.layout.header_values.read([header.payload])
            ambiguity = _or(values.get("ambiguity"), ambiguity)
            blockage = _or(values.get("blockage"), blockage)
        if header is not None and header.cycle is not None and self.cadence is not None:
            self.cadence.add(header.cycle, header.received_ns)
        sent_ns = cycle.opened_ns if header is None else header.received_ns
        limit = self._count(header.payload) if header is not None and self.layout.counts else None
        range_, azimuth, range_rate, rcs = self._detections(cycle, limit) if frames else _NOTHING
        stamp_ns = sent_ns - round(age * 1e9)
        lag, missed = (0.0, 0) if self.cadence is None else (self.cadence.lag, self.cadence.missed)
        return RadarScan(self.sensor, stamp_ns, received_ns, range_, azimuth, range_rate, rcs, ambiguity, blockage, lag, missed)

    def _age(self, cycle: Cycle) -> float:
        """Seconds from the measurement to the header; 0 where the sensor does not report it."""
        payload, self.age_payload = self.age_payload, None
        if self.layout.age_message is None and cycle.header is not None:
            payload = cycle.header.payload
        if payload is None or self.layout.age is None:
            return 0.0
        return _or(self.layout.age.read([payload])["age"], 0.0)

    def _checksum_holds(self, cycle: Cycle, crc: Checksum) -> bool:
        """Over the header, less the checksum itself, and the detection frames by slot."""
        if cycle.header is None:
            return False
        detections = b"".join(frame.payload for frame in cycle.detection_frames())
        if self.layout.crc_in_header:
            return crc.holds(cycle.header.payload, crc.others(cycle.header.payload) + detections)
        return cycle.end is not None and crc.holds(cycle.end.payload, cycle.header.payload + detections)

    def _detections(self, cycle: Cycle, limit: int | None) -> tuple[Floats, Floats, Floats, Floats]:
        """Range, azimuth, range rate and RCS of the valid ones, the nearest `max_detections` in order of arrival."""
        values = self.layout.detections.read([frame.payload for frame in cycle.detection_frames()])
        if limit is not None:
            values = {name: value[:limit] for name, value in values.items()}
        polar = _polar(values)
        sound = np.isfinite(polar[0] + polar[1] + polar[2]) & (polar[0] > 0)  # the reader's values are small numbers, or NaN
        kept = np.flatnonzero(sound)
        self.health.invalid += len(sound) - len(kept)
        if len(kept) > self.profile.max_detections:
            self.health.truncated += len(kept) - self.profile.max_detections
            nearest = np.argsort(polar[0][kept], kind="stable")[: self.profile.max_detections]
            kept = kept[np.sort(nearest)]
        return polar[0][kept], polar[1][kept], polar[2][kept], polar[3][kept]


_NOTHING = (np.empty(0),) * 4


def _or(value: Floats | None, default: float) -> float:
    return default if value is None or math.isnan(value[0]) else float(value[0])


def _polar(values: dict[str, Floats]) -> tuple[Floats, Floats, Floats, Floats]:
    """Range, azimuth, range rate, RCS; from positions and velocities where the sensor reports those."""
    if "x" in values:
        range_, azimuth = np.hypot(values["x"], values["y"]), np.arctan2(values["y"], values["x"])
    else:
        range_, azimuth = values["range"], values["azimuth"]
    range_rate = values["range_rate"] if "vx" not in values else np.cos(azimuth) * values["vx"] + np.sin(azimuth) * values["vy"]
    rcs = values["rcs"] if "rcs" in values else np.full(len(range_), np.nan)
    return range_, azimuth, range_rate, rcs


class _Layout:
    """A radar profile resolved against its DBC: which signal of which message is what."""

    def __init__(self, profile: RadarProfile, dbc: Dbc) -> None:
        self.profile = profile
        self.dbc = dbc
        header, detections = profile.header, profile.detections
        self.messages = [dbc.message(name, "detections.messages") for name in _message_names(detections, dbc)]
        first = self.messages[0]
        quantities = {
            name: quantity
            for name in ("range", "azimuth", "range_rate", "x", "y", "vx", "vy", "rcs")
            if (quantity := getattr(detections, name)) is not None
        }
        self.detections = QuantityReader(
            dbc,
            self.messages,
            quantities,
            "detections",
            valid=detections.valid,
            per_frame=detections.per_frame,
            first_k=detections.first_k,
            first_n=detections.n[0] if detections.n else 0,
        )
        self.page = self._integer(detections.page, "detections.page")
        self.detections_cycle = self._integer(detections.cycle, "detections.cycle")
        self.frame_crc: Checksum | None = None
        if detections.crc is not None:
            crc = detections.crc
            self.frame_crc = dbc.checksum(first, self._first(crc.signal), crc.algorithm, "detections.crc", crc.data_ids)
        self.counts = []
        self.cycle: SignalLayout | None = None
        self.header_values: QuantityReader | None = None
        self.age: QuantityReader | None = None
        self.age_message: Message | None = None
        self.cycle_crc: Checksum | None = None
        self.crc_in_header = False
        self.ends_with = profile.ends_with
        if header is not None:
            message = dbc.message(header.message, "header.message")
            self.counts = [dbc.integer(message, name, "header.count") for name in header.count]
            self.cycle = dbc.integer(message, header.cycle, "header.cycle") if header.cycle else None
            values = {name: q for name in ("ambiguity", "blockage") if (q := getattr(header, name)) is not None}
            self.header_values = QuantityReader(dbc, [message], values, "header") if values else None
            if header.age is not None:
                carrier = dbc.message(header.age_message or header.message, "header.age_message")
                self.age = QuantityReader(dbc, [carrier], {"age": header.age}, "header.age")
                self.age_message = carrier if header.age_message else None
        if profile.crc is not None:
            carrier = dbc.message(profile.crc.message, "crc.message")
            self.cycle_crc = dbc.checksum(carrier, profile.crc.signal, profile.crc.algorithm, "crc")
            self.crc_in_header = header is not None and profile.crc.message == header.message
            if not self.crc_in_header:
                self.ends_with = profile.crc.message

    def _integer(self, template: str | None, key: str) -> SignalLayout | None:
        return None if template is None else self.dbc.integer(self.messages[0], self._first(template), key)

    def _first(self, template: str) -> str:
        """A signal's name in the first detection message: all are laid out alike, so its layout serves for all."""
        detections = self.profile.detections
        return fill(template, "detections", self.dbc, n=detections.n[0] if detections.n else 0)

    def roles(self, id_offset: int) -> dict[FrameId, FrameRole]:
        """What each id's frames are, with this radar's offset on the DBC's ids."""
        header = self.profile.header
        roles: dict[FrameId, FrameRole] = {}
        end = self.dbc.message(self.ends_with, "ends_with") if self.ends_with else None
        named: list[tuple[FrameKind | None, Message, int | None]] = []
        if end is not None:
            named.append((FrameKind.END, end, None))
        if self.age_message is not None:
            named.append((None, self.age_message, None))
        if header is not None:
            named.append((FrameKind.HEADER, self.dbc.message(header.message, "header.message"), None))
        for number, message in enumerate(self.messages):
            named.append((FrameKind.DETECTIONS, message, number if len(self.messages) > 1 else None))
        for kind, message, slot in named:  # a detection message or the header may end the cycle as well: the later role counts
            last = end is not None and message.name == end.name
            frame_id = (message.frame_id + id_offset, message.is_extended_frame)
            roles[frame_id] = FrameRole(kind, message.length, slot, last)
        return roles


def _message_names(detections: Detections, dbc: Dbc) -> list[str]:
    if detections.n is None:
        return [detections.messages]
    first, last = detections.n
    return [fill(detections.messages, "detections.messages", dbc, n=n) for n in range(first, last + 1)]
