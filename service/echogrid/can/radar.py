"""One radar's frames into scans, as its profile says."""

from __future__ import annotations

import math
from collections.abc import Sequence

import can
import numpy as np

from echogrid.can.cadence import Cadence
from echogrid.can.database import Message
from echogrid.can.dbc import Checksum, Dbc
from echogrid.can.decode import Payloads, SignalLayout
from echogrid.can.profile import Detections, RadarProfile
from echogrid.can.quantity import QuantityReader, fill
from echogrid.core.health import SensorHealth
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.radar.scan import NO_FIELD, Assembly, AssemblyRule, Cycle, Field, FrameKind, FrameRole, known_row

FrameId = tuple[int, bool]  # arbitration id, extended


class RadarReader:
    """Remembers the number of the last complete cycle. Frames are put together in an `Assembly`, of one radar or of several."""

    def __init__(self, sensor: str, profile: RadarProfile, dbc: Dbc, id_offset: int, health: SensorHealth, latency_ms: float = 0.0) -> None:
        """`latency_ms` is added to the profile's. Raises EchogridError where the profile names what the DBC does not have."""
        self.sensor = sensor
        self.latency = (profile.latency_ms + latency_ms) * 1e-3  # s
        self.profile = profile
        self.health = health
        self.layout = layout = _Layout(profile, dbc)
        self.roles = layout.roles(id_offset)
        self.cadence = Cadence(layout.cycle.length) if layout.cycle is not None else None
        self.rule = AssemblyRule(
            ends_with_message=layout.ends_with is not None,
            has_header=profile.header is not None,
            frames=profile.frames,
            cycle_bits=profile.detections.cycle_bits,
            timeout_ns=round(profile.timeout_ms * 1e6),
            per_frame=profile.detections.per_frame,
            cycle=_field(layout.cycle),
            detections_cycle=_field(layout.detections_cycle),
            page=_field(layout.page),
            counts=tuple(map(_field, layout.counts)),
        )
        self._alone = Alone(self)

    @property
    def ids(self) -> set[FrameId]:
        """The frames that are read."""
        return set(self.roles)

    def add(self, message: can.Message, received_ns: int) -> RadarScan | None:
        """The scan that this frame completes, if any. Raises ValueError for a bad frame."""
        return self._alone.add(message, received_ns)

    def scans(self, messages: Sequence[can.Message], received_ns: Sequence[int]) -> list[RadarScan]:
        """Those that frames (N,) complete, one after the other; bad frames are passed over."""
        return self._alone.scans(messages, received_ns)

    def holds(self, role: FrameRole, payload: bytes) -> bool:
        """Whether the frame's own checksum, if it has one, is right."""
        crc = self.layout.frame_crc
        return crc is None or role.kind is not FrameKind.DETECTIONS or crc.holds(payload)

    def scan(self, cycle: Cycle, received_ns: int) -> RadarScan | None:
        """What a whole cycle says; None, and counted, where its checksum is wrong."""
        layout, length = self.layout, self.layout.messages[0].length
        detections = cycle.detections[:, :length]
        if layout.cycle_crc is not None and not self._checksum_holds(cycle, detections.tobytes(), layout.cycle_crc):
            self.health.bad_crc += 1
            return None
        values = {} if cycle.header_ns is None or layout.header_values is None else layout.header_values.read(cycle.header)
        if layout.age_message is not None and layout.age is not None and cycle.age is not None:
            values |= layout.age.read(cycle.age)
        age = _or(values.get("age"), 0.0) + self.latency
        if cycle.header_ns is not None and self.cadence is not None:
            self.cadence.add(cycle.number, cycle.header_ns)
        sent_ns = cycle.opened_ns if cycle.header_ns is None else cycle.header_ns
        range_, azimuth, range_rate, rcs = self._detections(detections, cycle.announced) if len(detections) else _NOTHING
        lag, missed = (0.0, 0) if self.cadence is None else (self.cadence.lag, self.cadence.missed)
        return RadarScan(
            self.sensor,
            sent_ns - round(age * 1e9),
            received_ns,
            range_,
            azimuth,
            range_rate,
            rcs,
            _or(values.get("ambiguity"), self.profile.ambiguity_interval),
            _or(values.get("blockage"), 0.0),
            lag,
            missed,
        )

    def _checksum_holds(self, cycle: Cycle, detections: bytes, crc: Checksum) -> bool:
        """Over the header, less the checksum itself, and the detection frames by slot."""
        if cycle.header_ns is None:
            return False
        header = cycle.header[0, : self.layout.header_length].tobytes()
        if self.layout.crc_in_header:
            return crc.holds(header, crc.others(header) + detections)
        return cycle.end is not None and crc.holds(cycle.end[0].tobytes(), header + detections)

    def _detections(self, rows: Payloads, limit: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Range, azimuth, range rate and RCS of the valid ones, the nearest `max_detections` in order of arrival. `limit` -1: none."""
        values = self.layout.detections.read(rows)
        if limit >= 0:
            values = {name: value[:limit] for name, value in values.items()}
        polar = _polar(values)
        sound = np.isfinite(polar[0] + polar[1] + polar[2]) & (polar[0] > 0)  # the reader's values are small numbers, or NaN
        kept = np.flatnonzero(sound)
        self.health.invalid += len(sound) - len(kept)
        if len(kept) > self.profile.max_detections:
            self.health.truncated += len(kept) - self.profile.max_detections
            nearest = np.argsort(polar[0][kept], kind="stable")[: self.profile.max_detections]
            kept = kept[np.sort(nearest)]
        elif len(kept) == len(sound):
            return polar
        return polar[0][kept], polar[1][kept], polar[2][kept], polar[3][kept]


class Alone:
    """One radar's frames, one by one."""

    def __init__(self, reader: RadarReader) -> None:
        self.reader = reader
        self._assembly = Assembly([reader.rule], [reader.health])
        self._known = np.array([known_row(0, role) for role in reader.roles.values()], np.int64)
        self._places = {frame_id: place for place, frame_id in enumerate(reader.roles)}

    def add(self, message: can.Message, received_ns: int) -> RadarScan | None:
        """As the reader's."""
        frame_id, payload = (message.arbitration_id, message.is_extended_id), bytes(message.data)
        role = self.reader.roles[frame_id]
        if len(payload) < role.length:
            raise ValueError("too short")
        right = self.reader.holds(role, payload[: role.length])
        found = self._whole([received_ns], [frame_id], [right], [payload])
        if not right:
            raise ValueError("wrong checksum")
        return found[0] if found else None

    def scans(self, messages: Sequence[can.Message], received_ns: Sequence[int]) -> list[RadarScan]:
        """As the reader's."""
        roles, frames = self.reader.roles, [((one.arbitration_id, one.is_extended_id), bytes(one.data)) for one in messages]
        sound = [at for at, (frame_id, payload) in enumerate(frames) if len(payload) >= roles[frame_id].length]
        ids, payloads = [frames[at][0] for at in sound], [frames[at][1] for at in sound]
        right = [self.reader.holds(roles[one], payload[: roles[one].length]) for one, payload in zip(ids, payloads, strict=True)]
        return [scan for scan in self._whole([received_ns[at] for at in sound], ids, right, payloads) if scan is not None]

    def _whole(self, received_ns: list[int], ids: list[FrameId], right: list[bool], payloads: list[bytes]) -> list[RadarScan | None]:
        """What the frames (N,) complete; None where a cycle's checksum is wrong."""
        sizes = np.array([len(payload) for payload in payloads], np.uint8)
        found = [
            self.reader.scan(cycle, received_ns[at])
            for at, _, cycle in self._assembly.take(
                np.array(received_ns, np.int64),
                np.array([self._places[one] for one in ids], np.int64),
                ~np.array(right, bool),
                sizes,
                np.cumsum(sizes, dtype=np.int64) - sizes,
                np.frombuffer(b"".join(payloads), np.uint8),
                self._known,
            )
        ]
        self._assembly.counted()
        return found


def _field(layout: SignalLayout | None) -> Field:
    return NO_FIELD if layout is None else (layout.lsb_byte, layout.step, layout.shift, layout.length, int(layout.is_signed))


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
        self.header_length = 0
        self.header_values: QuantityReader | None = None  # of the age too, where the header has it
        self.age: QuantityReader | None = None
        self.age_message: Message | None = None
        self.cycle_crc: Checksum | None = None
        self.crc_in_header = False
        self.ends_with = profile.ends_with
        if header is not None:
            message = dbc.message(header.message, "header.message")
            self.counts = [dbc.integer(message, name, "header.count") for name in header.count]
            self.cycle = dbc.integer(message, header.cycle, "header.cycle") if header.cycle else None
            self.header_length = message.length
            names = ("ambiguity", "blockage") if header.age_message else ("ambiguity", "blockage", "age")
            values = {name: q for name in names if (q := getattr(header, name)) is not None}
            self.header_values = QuantityReader(dbc, [message], values, "header") if values else None
            if header.age is not None and header.age_message:
                self.age_message = dbc.message(header.age_message, "header.age_message")
                self.age = QuantityReader(dbc, [self.age_message], {"age": header.age}, "header.age")
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
        named: list[tuple[FrameKind, Message, int | None]] = []
        if end is not None:
            named.append((FrameKind.END, end, None))
        if self.age_message is not None:
            named.append((FrameKind.AGE, self.age_message, None))
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
