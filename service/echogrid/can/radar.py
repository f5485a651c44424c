"""One radar's frames into scans, as its profile says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import can
import numpy as np

from echogrid.can.cadence import Cadence
from echogrid.can.database import FrameId, Message
from echogrid.can.dbc import Checksum, Dbc
from echogrid.can.decode import SignalLayout, place_of
from echogrid.can.profile import Detections, RadarProfile
from echogrid.can.quantity import QuantityReader, fill, most_in_a_frame
from echogrid.core.health import SensorHealth
from echogrid.core.kernels.identify import Sort
from echogrid.core.kernels.scans import NEVER, chosen
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.radar.scan import (
    ALWAYS,
    COLUMNS,
    VALUES,
    Assembly,
    AssemblyRule,
    Columns,
    Cycle,
    FrameKind,
    FrameRole,
    Frames,
    Unread,
    known_row,
)
from echogrid.errors import EchogridError


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
            ends_with_message=layout.end_message is not None,
            has_header=profile.header is not None,
            frames=profile.frames,
            cycle_bits=profile.detections.cycle_bits,
            timeout_ns=round(profile.timeout_ms * 1e6),
            per_frame=layout.in_a_frame,
            cycle=place_of(layout.cycle),
            detections_cycle=place_of(layout.detections_cycle),
            page=place_of(layout.page),
            counts=tuple(map(place_of, layout.counts)),
            most=profile.max_detections,
            bytes=layout.messages[0].length,
            header_bytes=0 if layout.header_message is None else layout.header_message.length,
            **layout.plans(),
            **layout.summing(),
        )
        self._sum = None if layout.cycle_crc is None else layout.cycle_crc.compute

    @cached_property
    def _alone(self) -> Alone:
        """Made where frames come one by one: the service has one `Assembly` for all radars, and no need of others."""
        return Alone(self)

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

    def check(self, role: FrameRole) -> Checksum | None:
        """A frame's own checksum."""
        return self.layout.frame_crc if role.kind is FrameKind.DETECTIONS else None

    def holds(self, role: FrameRole, payload: bytes) -> bool:
        """Whether the frame's own checksum, if it has one, is right."""
        crc = self.check(role)
        return crc is None or crc.holds(payload)

    def scan(self, cycle: Cycle, received_ns: int) -> RadarScan | None:
        """What a whole cycle says; None, and counted, where its checksum is wrong or its frames have less than its header says."""
        health, cadence = self.health, self.cadence
        if self._sum is not None and (cycle.summed is None or self._sum(cycle.summed) != cycle.said):
            health.bad_crc += 1
            return None
        values, columns, invalid, truncated = cycle.values, cycle.columns, cycle.invalid, cycle.truncated
        if cycle.unread is not None:
            values = self._values(cycle.unread)
            detections = self._detections(cycle.unread)
            if detections is None:
                health.incomplete += 1
                return None
            columns, invalid, truncated = detections
        health.invalid += invalid
        health.truncated += truncated
        age, ambiguity, blockage = values
        lag, missed, sent_ns = 0.0, 0, cycle.opened_ns
        if cycle.header_ns is not None:
            sent_ns = cycle.header_ns
            if cadence is not None:
                cadence.add(cycle.number, sent_ns)
        if cadence is not None:
            lag, missed = cadence.lag, cadence.missed
        return RadarScan(
            self.sensor,
            sent_ns - round(((0.0 if age != age else age) + self.latency) * 1e9),  # not itself: NaN, not said
            received_ns,
            *columns,
            self.profile.ambiguity_interval if ambiguity != ambiguity else ambiguity,
            0.0 if blockage != blockage else blockage,
            lag,
            missed,
        )

    def _values(self, cycle: Unread) -> list[float]:
        """As a cycle's, of what the loops cannot read."""
        layout, found = self.layout, dict[str, Floats]()
        if cycle.header is not None and layout.header_values is not None:
            found = layout.header_values.read(cycle.header)
        if cycle.age is not None and layout.age is not None:
            found |= layout.age.read(cycle.age)
        return [float(found[name][0]) if name in found else math.nan for name in VALUES]

    def _detections(self, cycle: Unread) -> tuple[Columns, int, int] | None:
        """As a cycle's columns, and how many are invalid and too many; None where some that were announced have not come."""
        if not len(cycle.detections):
            return (np.empty(0),) * 4, 0, 0
        found = _polar(self.layout.detections.read_there(cycle.detections))
        if cycle.announced > found.shape[1]:
            return None
        kept, invalid, truncated = chosen(found[:, : cycle.announced] if cycle.announced >= 0 else found, self.profile.max_detections)
        return (kept[0], kept[1], kept[2], kept[3]), invalid, truncated


class Alone:
    """One radar's frames, one by one."""

    def __init__(self, reader: RadarReader) -> None:
        self.reader = reader
        known = np.array([known_row(0, role) for role in reader.roles.values()], np.int64)
        self._assembly = Assembly([reader.rule], [reader.health], known)
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
        frames = Frames(
            np.array(received_ns, np.int64),
            np.array([self._places[one] for one in ids], np.int64),
            np.full(len(ids), Sort(0), np.uint8),  # whatever their times are
            ~np.array(right, bool),
            sizes,
            np.cumsum(sizes, dtype=np.int64) - sizes,
            np.frombuffer(b"".join(payloads), np.uint8),
        )
        taken = self._assembly.take(frames, 0, len(ids), NEVER, ALWAYS)
        self._assembly.counted()
        return [self.reader.scan(cycle, received_ns[cycle.place]) for cycle in taken.cycles]


def _polar(values: dict[str, Floats]) -> Floats:
    """(4, N): range, azimuth, range rate, RCS; from positions and velocities where the sensor reports those."""
    if "x" in values:
        range_, azimuth = np.hypot(values["x"], values["y"]), np.arctan2(values["y"], values["x"])
    else:
        range_, azimuth = values["range"], values["azimuth"]
    range_rate = values["range_rate"] if "vx" not in values else np.cos(azimuth) * values["vx"] + np.sin(azimuth) * values["vy"]
    rcs = values["rcs"] if "rcs" in values else np.full(len(range_), np.nan)
    return np.stack((range_, azimuth, range_rate, rcs))


class _Layout:
    """A radar profile resolved against its DBC: which signal of which message is what. Of the DBC it keeps these messages alone: a car's
    own can have thousands."""

    def __init__(self, profile: RadarProfile, dbc: Dbc) -> None:
        header, detections = profile.header, profile.detections
        self.messages = [dbc.message(name, "detections.messages") for name in _message_names(detections, dbc)]
        first, first_n = self.messages[0], detections.n[0] if detections.n else 0
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
            first_n=first_n,
        )

        def name(template: str) -> str:  # of a signal in the first message: all are laid out alike
            return fill(template, "detections", dbc, n=first_n)

        numbers = range(detections.first_k, detections.first_k + detections.per_frame)
        whole = [[fill(one, "detections", dbc, n=first_n, k=k) for one in self.detections.needed] for k in numbers]
        try:
            self.in_a_frame = most_in_a_frame(first, whole)
        except ValueError as error:
            raise EchogridError(f"{dbc.profile}: detections: {dbc.path}: {error}") from error
        page, cycle, crc = detections.page, detections.cycle, detections.crc
        self.page = dbc.integer(first, name(page), "detections.page") if page else None
        self.detections_cycle = dbc.integer(first, name(cycle), "detections.cycle") if cycle else None
        self.frame_crc: Checksum | None = None
        if crc is not None:
            self.frame_crc = dbc.checksum(first, name(crc.signal), crc.algorithm, "detections.crc", crc.data_ids)
        self.counts = []
        self.cycle: SignalLayout | None = None
        self.header_values: QuantityReader | None = None  # of the age too, where the header has it
        self.age: QuantityReader | None = None
        self.header_message: Message | None = None
        self.age_message: Message | None = None
        self.cycle_crc: Checksum | None = None
        self.crc_in_header = False
        ends_with = profile.ends_with
        if header is not None:
            self.header_message = message = dbc.message(header.message, "header.message")
            self.counts = [dbc.integer(message, name, "header.count") for name in header.count]
            self.cycle = dbc.integer(message, header.cycle, "header.cycle") if header.cycle else None
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
                ends_with = profile.crc.message
        self.end_message = dbc.message(ends_with, "ends_with") if ends_with else None

    def plans(self) -> dict[str, Any]:
        """For an AssemblyRule; none where the loops cannot read all that there is to read."""
        polar = {"range", "azimuth", "range_rate"} <= set(self.detections.quantities) <= set(COLUMNS)
        plan = self.detections.plan(COLUMNS) if polar else None
        header = None if self.header_values is None else self.header_values.plan(VALUES)
        age = None if self.age is None else self.age.plan(VALUES)
        if plan is None or (header is None and self.header_values is not None) or (age is None and self.age is not None):
            return {}
        return {"plan": plan, "header_plan": header, "age_plan": age}

    def summing(self) -> dict[str, Any]:
        """For an AssemblyRule: where the cycle's checksum is."""
        crc = self.cycle_crc
        if crc is None:
            return {}
        if not self.crc_in_header:
            return {"summed": FrameKind.END, "sum": place_of(crc.layout)}
        return {"summed": FrameKind.HEADER, "sum": place_of(crc.layout), "sum_bytes": crc.place}

    def roles(self, id_offset: int) -> dict[FrameId, FrameRole]:
        """What each id's frames are, with this radar's offset on the DBC's ids."""
        roles: dict[FrameId, FrameRole] = {}
        end = self.end_message
        named: list[tuple[FrameKind, Message, int | None]] = []
        for kind, one in ((FrameKind.END, end), (FrameKind.AGE, self.age_message), (FrameKind.HEADER, self.header_message)):
            if one is not None:
                named.append((kind, one, None))
        for number, message in enumerate(self.messages):
            named.append((FrameKind.DETECTIONS, message, number if len(self.messages) > 1 else None))
        for kind, message, slot in named:  # a detection message or the header may end the cycle as well: the later role counts
            last = end is not None and message.name == end.name
            frame_id = (message.frame_id + id_offset, message.is_extended_frame)
            bits = 29 if message.is_extended_frame else 11
            if not 0 <= frame_id[0] < 1 << bits:
                found = f"{id_offset} found, which takes '{message.name}' to {frame_id[0]:#x}"
                raise EchogridError(f"id_offset: {found}, expected one that leaves ids of {bits} bits")
            roles[frame_id] = FrameRole(kind, message.length, slot, last)
        return roles


def _message_names(detections: Detections, dbc: Dbc) -> list[str]:
    if detections.n is None:
        return [detections.messages]
    first, last = detections.n
    return [fill(detections.messages, "detections.messages", dbc, n=n) for n in range(first, last + 1)]
