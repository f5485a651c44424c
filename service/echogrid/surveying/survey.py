"""The spine of a survey: from the frames of a recording and the DBCs to radars, ego motion, signs and mounts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from echogrid.can.database import Message
from echogrid.core.messages import EgoMotion
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.judging.recorded import RadarTrack, Track, collect
from echogrid.judging.values import speed_leaps, yaw_rate_leaps
from echogrid.surveying.drafts import Draft, motion_draft, motion_signals, radar_draft
from echogrid.surveying.groups import groups_of
from echogrid.surveying.heard import Channel
from echogrid.surveying.mounts import Placed, Signs, placed, seen, signs_of
from echogrid.surveying.senders import RADIUS, MotionSender, Sender, Source, motion_of, radars_of
from echogrid.surveying.words import corner_of

MOST_TRIED = 8  # candidates for ego motion
STILL = 0.2  # m/s: a speed that never exceeds it is none, or the car stood
LEAPS = 0.05
BEND = 0.05  # rad/s
DEGREES = 1.5  # rad/s and rad: values beyond are degrees
ANYWHERE = Mount(SE2(0.0, 0.0, 0.0), np.pi, 1e3)
ROUND_FOV, LEAST_FOV = 10.0, 20.0  # deg


@dataclass(slots=True, eq=False)
class Radar:
    """A radar as it will be configured."""

    sender: Sender
    mount: Placed
    fov_deg: float


@dataclass(slots=True, eq=False)
class Survey:
    """What was found. `motion`: None where nothing is like it. `radius` (m): of the wheels, where their profile needs one.

    `first_bend`: s from the begin, and degrees, left is positive; None where there is none.
    """

    channels: tuple[Channel, ...]  # those that something is read of
    radars: tuple[Radar, ...]
    motion: MotionSender | None
    radius: float | None
    signs: Signs
    drafts: dict[str, Draft]  # by the kind of their owners
    first_bend: tuple[float, float] | None
    skeletons: tuple[Draft, ...]  # of what the DBCs have, and the recording does not show


def survey(channels: Sequence[Channel], sources: Sequence[Source]) -> Survey:
    """Of all channels of a recording, with all DBCs that there are."""
    senders = sorted(radars_of(channels, sources), key=lambda one: (str(one.channel.name), one.shift))
    radars = [_track(one) for one in senders]
    motion, speed, yaw_rate = _best_motion(motion_of(channels, sources), radars)
    told = [seen(radar, speed, yaw_rate) for radar in radars]
    corners = [next((c for name in one.names if (c := corner_of(name)) is not None), None) for one in senders]
    kinds = [_kind(one) for one in senders]
    own = {kind for kind, one in zip(kinds, senders, strict=True) if one.profile is None}
    signs = signs_of(told, kinds, corners, own, turns=motion is not None and motion.profile is None)
    turned = [None if one is None else one.signed(signs.azimuth[k], signs.rate[k], signs.turn) for one, k in zip(told, kinds, strict=True)]
    mounts = placed(turned, corners, signs.sure)
    drafts = {kind: one.draft for kind, one in zip(kinds, senders, strict=True) if one.draft is not None}
    for kind, draft in drafts.items():
        _turn(draft, ("azimuth", "y", "vy"), signs.azimuth[kind])
        _turn(draft, ("range_rate", "vx", "vy"), signs.rate[kind])
    if motion is not None and motion.draft is not None and signs.turn < 0:
        motion.draft.tables["yaw_rate"]["yaw_rate"]["sign"] = -1
    scale = float(np.median([one.scale for one in told if one is not None] or [1.0]))
    radius = round(RADIUS * scale, 3) if motion is not None and motion.radius else None
    found = [Radar(s, m, _fov(r)) for s, m, r in zip(senders, mounts, radars, strict=True)]
    found.sort(key=lambda one: ORDER.index(one.mount.name) if one.mount.name in ORDER else len(ORDER))
    used = {one.channel.name for one in senders} | ({motion.channel.name} if motion is not None else set())
    return Survey(
        tuple(c for c in channels if c.name in used),
        tuple(found),
        motion,
        radius,
        signs,
        drafts,
        _first_bend(yaw_rate, signs.turn),
        skeletons(channels, sources, bool(found), motion),
    )


ORDER = ("front_left", "front_right", "rear_left", "rear_right")


def skeletons(channels: Sequence[Channel], sources: Sequence[Source], radars: bool, motion: MotionSender | None) -> tuple[Draft, ...]:
    """Profiles whose signals are those of the DBCs, where no frames of them could be read."""

    def heard(messages: Sequence[Message]) -> tuple[str, ...]:
        return tuple(one.name for one in messages if any(c.has(one.id) and c.lengths[one.id] >= one.length for c in channels))

    found = []
    groups = [(group, source.path) for source in sources for group in groups_of(source.database)]
    if not radars and groups:
        group, path = max(groups, key=lambda one: len(one[0].messages) * one[0].per_frame)
        found.append(replace(radar_draft(group, None, path), heard=heard(group.messages)))
    signals = [(one, source.path) for source in sources for one in motion_signals(source.database)[:1]]
    if motion is None and signals:
        one, path = signals[0]
        found.append(replace(motion_draft(one, path, (), ())[0], heard=heard((one.wheels, one.turning))))
    return tuple(found)


def _kind(sender: Sender) -> str:
    """Radars of one kind share a profile."""
    return sender.profile or f"draft {id(sender.draft)}"


def _track(sender: Sender) -> RadarTrack:
    """The scans as arrays; azimuths without a unit that are beyond a half turn are degrees."""
    scans = [msgspec.structs.replace(scan, sensor="radar") for scan in sender.scans]
    (track,) = collect((), scans, {"radar": ANYWHERE}).radars
    draft = sender.draft
    if draft is not None and ("detections", "azimuth") in draft.remarks and len(track.azimuth):
        quantity = draft.tables["detections"]["azimuth"]
        if quantity["unit"] == "rad" and float(np.percentile(np.abs(track.azimuth), 99)) > np.pi:
            quantity["unit"] = "deg"
        if quantity["unit"] == "deg":
            track = replace(track, azimuth=np.radians(track.azimuth))
    return replace(track, time=track.time + (sender.scans[0].stamp_ns * 1e-9 if sender.scans else 0.0))


def _tracks(motion: Sequence[EgoMotion]) -> tuple[Track, Track]:
    """Speed and yaw rate, s since 1970."""
    recorded = collect(motion, (), {})
    begin = recorded.begin_ns * 1e-9
    return replace(recorded.speed, time=recorded.speed.time + begin), replace(recorded.yaw_rate, time=recorded.yaw_rate.time + begin)


def _best_motion(candidates: Sequence[MotionSender], radars: Sequence[RadarTrack]) -> tuple[MotionSender | None, Track, Track]:
    """The candidate whose values are like a car's and that fits the radars best; without radars, the first."""
    nothing = Track(np.empty(0), np.empty(0))
    tried: list[tuple[float, int, MotionSender, Track, Track]] = []
    for n, candidate in enumerate(candidates[:MOST_TRIED]):
        speed, yaw_rate = _tracks(candidate.motion)
        yaw_rate = _in_radians(candidate, yaw_rate)
        if len(speed) < 2 or len(yaw_rate) < 2 or speed_leaps(speed) > LEAPS or yaw_rate_leaps(yaw_rate) > LEAPS:
            continue
        fits = [one for radar in radars if (one := seen(radar, speed, yaw_rate)) is not None]
        still = float(np.max(np.abs(speed.value))) < STILL
        cost = float(np.median([one.spread for one in fits])) if fits else 10.0
        tried.append((round(cost, 1) + 100 * still, n, candidate, speed, yaw_rate))
    if not tried:
        return None, nothing, nothing
    _, _, best, speed, yaw_rate = min(tried, key=lambda one: one[:2])
    return best, _in_metres(best, speed, radars, yaw_rate), yaw_rate


def _in_radians(candidate: MotionSender, yaw_rate: Track) -> Track:
    """A yaw rate without a unit that no car has in rad/s is in degrees/s."""
    draft = candidate.draft
    if draft is None or ("yaw_rate", "yaw_rate") not in draft.remarks or not len(yaw_rate):
        return yaw_rate
    quantity: dict[str, Any] = draft.tables["yaw_rate"]["yaw_rate"]
    if quantity["unit"] == "rad/s" and float(np.percentile(np.abs(yaw_rate.value), 99)) > DEGREES:
        quantity["unit"] = "deg/s"
    return replace(yaw_rate, value=np.radians(yaw_rate.value)) if quantity["unit"] == "deg/s" else yaw_rate


def _in_metres(motion: MotionSender, speed: Track, radars: Sequence[RadarTrack], yaw_rate: Track) -> Track:
    """A speed without a unit that is 3.6 times what the radars measure is in km/h."""
    draft = motion.draft
    if draft is None or not any(("wheel_speeds", key) in draft.remarks for key in ("rear_left", "rear_right")):
        return speed
    scales = [one.scale for radar in radars if (one := seen(radar, speed, yaw_rate)) is not None]
    if not scales or abs(float(np.median(scales)) * 3.6 - 1) > 0.1:
        return speed
    for key in ("rear_left", "rear_right"):
        draft.tables["wheel_speeds"][key]["unit"] = "km/h"
    return replace(speed, value=speed.value / 3.6)


def _first_bend(yaw_rate: Track, sign: int) -> tuple[float, float] | None:
    """When it begins, s from the first sample, and by how many degrees it turns."""
    turning = np.flatnonzero(np.abs(yaw_rate.value) > BEND)
    while len(turning):
        first = int(turning[0])
        same = np.sign(yaw_rate.value[first:]) == np.sign(yaw_rate.value[first])
        end = first + (int(np.argmin(same)) if not same.all() else len(same))
        angle = float(np.trapezoid(yaw_rate.value[first:end], yaw_rate.time[first:end]))
        if abs(angle) > math.radians(15):
            return float(yaw_rate.time[first] - yaw_rate.time[0]), sign * math.degrees(angle)
        turning = turning[turning >= end]
    return None


def _turn(draft: Draft, keys: Sequence[str], sign: int) -> None:
    for key in keys:
        if sign < 0 and key in draft.tables["detections"]:
            quantity = draft.tables["detections"][key]
            quantity["sign"] = -quantity.get("sign", 1)
            if quantity["sign"] == 1:
                del quantity["sign"]
            else:
                draft.remarks.setdefault(("detections", key), "the sign, by Doppler in bends")


def _fov(radar: RadarTrack) -> float:
    """deg, of nearly all detections."""
    if not len(radar.azimuth):
        return 150.0
    half = float(np.degrees(np.percentile(np.abs(radar.azimuth), 99.5)))
    return float(min(max(np.ceil(2 * half / ROUND_FOV) * ROUND_FOV, LEAST_FOV), 360.0))
