"""Who sends what in a recording: profiles tried on each channel's frames, at every offset of ids, and kept where scans come out whole."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import can
import msgspec

from echogrid.can.database import Database, FrameId, Message
from echogrid.can.dbc import Dbc
from echogrid.can.motion import MotionReader
from echogrid.can.profile import MotionProfile, RadarProfile, load_motion, load_radar, shipped
from echogrid.can.radar import RadarReader
from echogrid.config.tables import Motion
from echogrid.core.health import Health, SensorHealth
from echogrid.core.messages import EgoMotion, RadarScan
from echogrid.errors import EchogridError
from echogrid.judging.listening import needed
from echogrid.surveying.cycles import Shape, moved, shape_of
from echogrid.surveying.drafts import Draft, motion_draft, motion_signals, radar_draft
from echogrid.surveying.groups import Group, groups_of
from echogrid.surveying.heard import Channel

FAR = 0x800  # an offset of ids is looked for no farther
WHOLE, FEWEST = 0.7, 8  # share of the scans, and their number, that must come out
SOME = 1000  # frames that are decoded first: several scans of any radar
RADIUS = 0.3  # m: of a wheel whose radius nobody has said


@dataclass(frozen=True, slots=True)
class Source:
    """A database with its file, as it was given."""

    path: Path
    database: Database


@dataclass(slots=True, eq=False)
class Sender:
    """A radar in the recording. `profile`: of a shipped one its name, else None and a draft. `share`: of its scans that are whole."""

    channel: Channel
    shift: int
    profile: str | None
    dbc: Path | None  # where the shipped profile needs one
    draft: Draft | None
    names: tuple[str, ...]  # of its messages in the DBC
    share: float
    scans: list[RadarScan] = field(default_factory=list)
    group: Group | None = None
    shape: Shape | None = None


@dataclass(slots=True, eq=False)
class MotionSender:
    """Ego motion in the recording; as in Sender. `radius`: whether a wheel radius is needed."""

    channel: Channel
    profile: str | None
    dbc: Path | None
    draft: Draft | None
    radius: bool
    motion: list[EgoMotion]
    messages: tuple[str, ...]


def radars_of(channels: Sequence[Channel], sources: Sequence[Source]) -> list[Sender]:
    """All radars: of shipped profiles that a checksum confirms, then of the given DBCs, then of other shipped profiles."""
    claimed: set[tuple[str | int, FrameId]] = set()
    found: list[Sender] = []
    known = list(_shipped_radars(sources))
    for name, profile, path, dbc in known:
        if profile.crc is not None or profile.detections.crc is not None:
            found += _of_profile(name, profile, path, dbc, channels, claimed)
    for source in sources:
        for group in groups_of(source.database):
            found += _of_group(group, source, channels, claimed)
    for name, profile, path, dbc in known:
        if profile.crc is None and profile.detections.crc is None:
            found += _of_profile(name, profile, path, dbc, channels, claimed)
    return found


def _shipped_radars(sources: Sequence[Source]) -> Iterator[tuple[str, RadarProfile, Path | None, Dbc]]:
    for path in sorted(shipped().glob("*.toml")):
        try:
            profile = load_radar(path)
        except EchogridError:
            continue  # of ego motion
        if profile.dbc is not None:
            yield path.stem, profile, None, Dbc(path.parent / profile.dbc, path)
            continue
        for source in sources:
            dbc = Dbc(source.path, path)
            try:
                RadarReader("", profile, dbc, 0, SensorHealth())
            except EchogridError:
                continue  # another DBC
            yield path.stem, profile, source.path, dbc


def _of_profile(
    name: str, profile: RadarProfile, path: Path | None, dbc: Dbc, channels: Sequence[Channel], claimed: set[tuple[str | int, FrameId]]
) -> list[Sender]:
    asked = RadarReader("", profile, dbc, 0, SensorHealth())
    ids = needed(asked)
    lengths = {frame_id: asked.roles[frame_id].length for frame_id in ids}
    found = []
    for channel in channels:
        for shift in _shifts(ids, lengths, channel):
            if any((channel.name, (number + shift, extended)) in claimed for number, extended in ids):
                continue
            decoded = decode(profile, dbc, shift, channel)
            if decoded is None:
                continue
            reader, scans, share = decoded
            claimed |= {(channel.name, frame_id) for frame_id in reader.ids}
            found.append(Sender(channel, shift, name, path, None, (), share, scans))
    return found


def _shifts(ids: Sequence[FrameId], lengths: dict[FrameId, int], channel: Channel) -> list[int]:
    """By how much all of the ids may be moved to be there, the nearest first."""
    first, extended = ids[0]
    near = [number - first for number, kind in channel.counts if kind == extended and abs(number - first) <= FAR]

    def fits(shift: int) -> bool:
        there = [(number + shift, kind) for number, kind in ids]
        return all(channel.has(one) and channel.lengths[one] == lengths[own] for one, own in zip(there, ids, strict=True))

    return sorted((shift for shift in near if fits(shift)), key=abs)


def decode(profile: RadarProfile, dbc: Dbc, shift: int, channel: Channel) -> tuple[RadarReader, list[RadarScan], float] | None:
    """The scans that a profile makes of the kept frames, and the share of whole ones; None where they are few."""
    reader = RadarReader("radar", profile, dbc, shift, SensorHealth())
    frames = channel.of(reader.ids)
    if not _scans(reader, frames[:SOME]):  # as most that are tried
        return None
    health = SensorHealth()
    reader = RadarReader("radar", profile, dbc, shift, health)
    scans = _scans(reader, frames)
    share = len(scans) / max(len(scans) + health.incomplete + health.bad_crc, 1)
    seen = sum(len(scan) for scan in scans)
    return (reader, scans, share) if share >= WHOLE and len(scans) >= FEWEST and seen >= len(scans) else None


def _scans(reader: RadarReader, frames: Sequence[can.Message]) -> list[RadarScan]:
    return reader.scans(frames, [round(frame.timestamp * 1e9) for frame in frames])


def _of_group(group: Group, source: Source, channels: Sequence[Channel], claimed: set[tuple[str | int, FrameId]]) -> list[Sender]:
    """At the ids of the DBC, and moved."""
    members = {message.name for one in groups_of(source.database) for message in one.messages}
    companions = [m for m in source.database.messages if m.name not in members and m.fault is None and 0 < m.length <= 64]
    named = {(message.frame_id, message.is_extended_frame): message.name for message in source.database.messages}
    first = (group.messages[0].frame_id, group.messages[0].is_extended_frame)
    found: list[Sender] = []
    for channel in channels:
        for shift in _shifts([first], {first: group.messages[0].length}, channel):
            ids = [moved(message, shift) for message in group.messages]
            if (channel.name, ids[0]) in claimed or (shift and not _alike(group, companions, channel, shift)):
                continue
            shape = shape_of(group, channel, shift, companions)
            if shape is None:
                continue
            same = next((one for one in found if one.shape is not None and _plain(one.shape) == _plain(shape)), None)
            draft = same.draft if same is not None and same.draft is not None else radar_draft(group, shape, source.path)
            dbc = Dbc(source.path, source.path)
            decoded = decode(msgspec.convert(draft.document, RadarProfile), dbc, shift, channel)
            if decoded is None:
                continue
            reader, scans, share = decoded
            claimed |= {(channel.name, frame_id) for frame_id in [*reader.ids, *ids]}
            names = tuple(named[one] for one in [*ids, *sorted(reader.ids)] if one in named)
            found.append(Sender(channel, shift, None, None, draft, names, share, scans, group, shape))
    return found


def _alike(group: Group, companions: Sequence[Message], channel: Channel, shift: int) -> bool:
    """Whether moved ids can be meant: a companion is there too, or the row of numbers is."""
    if group.n is not None and sum(channel.has(moved(message, shift)) for message in group.messages) < min(len(group.messages), 4):
        return False
    return group.n is not None or any(
        channel.has(one := moved(message, shift)) and channel.lengths[one] == message.length for message in companions
    )


def _plain(shape: Shape) -> tuple[object, ...]:
    header = shape.header.name if shape.header is not None else None
    return header, shape.count, shape.cycle, shape.frames, shape.ends_with, shape.page, shape.detections_cycle, shape.frame_crc, shape.crc


def motion_of(channels: Sequence[Channel], sources: Sequence[Source]) -> list[MotionSender]:
    """All that may be ego motion, the likeliest first: shipped profiles that are confirmed by checksums, then the DBCs' signals."""
    found = []
    for path in sorted(shipped().glob("*.toml")):
        try:
            profile = load_motion(path)
        except EchogridError:
            continue  # a radar's
        options = [(None, path.parent / profile.dbc)] if profile.dbc is not None else [(source.path, source.path) for source in sources]
        for given, file in options:
            try:
                MotionReader(profile, Dbc(file, path), _motion(profile), Health())
            except EchogridError:
                continue  # another DBC
            for channel in channels:
                motion = _decoded_motion(profile, Dbc(file, path), channel)
                if motion:
                    names = profile.wheel_speeds.message, profile.yaw_rate.message
                    found.append(MotionSender(channel, path.stem, given, None, profile.wheel_speeds.are_turn_rates, motion, names))
    for source in sources:
        for signals in motion_signals(source.database):
            ids = [moved(message, 0) for message in (signals.wheels, signals.turning)]
            for channel in channels:
                if not all(
                    channel.has(one) and channel.lengths[one] >= m.length
                    for one, m in zip(ids, (signals.wheels, signals.turning), strict=True)
                ):
                    continue
                wheels, turning = (
                    [bytes(f.data[: m.length]) for f in channel.of([moved(m, 0)])] for m in (signals.wheels, signals.turning)
                )
                draft, radius = motion_draft(signals, source.path, wheels, turning)
                profile = msgspec.convert(draft.document, MotionProfile)
                motion = _decoded_motion(profile, Dbc(source.path, source.path), channel)
                if motion:
                    names = signals.wheels.name, signals.turning.name
                    found.append(MotionSender(channel, None, None, draft, radius, motion, names))
    return found


def _motion(profile: MotionProfile) -> Motion:
    return Motion(bus="", wheel_radius=RADIUS if profile.wheel_speeds.are_turn_rates else None)


def _decoded_motion(profile: MotionProfile, dbc: Dbc, channel: Channel) -> list[EgoMotion]:
    """Nothing where most frames are not understood."""
    try:
        reader = MotionReader(profile, dbc, _motion(profile), Health())
    except EchogridError:
        return []
    if not all(channel.has(one) for one in (reader.wheel_id, reader.yaw_id)):
        return []
    found: list[EgoMotion] = []
    frames = channel.of([reader.wheel_id, reader.yaw_id])
    for message in channel.of(reader.ids):
        try:
            found += reader.add(message, round(message.timestamp * 1e9))
        except ValueError:
            continue
    return found if len(found) > WHOLE * len(frames) else []
