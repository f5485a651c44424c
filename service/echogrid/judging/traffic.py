"""Which frames of a configuration are in a recording, and where those are that are not where they should be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from echogrid.can.database import FrameId
from echogrid.judging.finding import Finding

Heard = Mapping[tuple[str, FrameId], int]  # frames by channel, as the recording names it, and id
FAR = 0x800  # an offset is looked for no farther
FEW = 3  # frames: fewer are strays


@dataclass(frozen=True, slots=True)
class Owner:
    """Who reads frames: a radar; "speed", "yaw rate" or "pose" (`radar` False). `ids`: those that must be there; `more`: those that may.

    `offset`: its id_offset.
    """

    name: str
    bus: str
    ids: tuple[FrameId, ...]
    radar: bool = True
    more: tuple[FrameId, ...] = ()
    offset: int = 0


@dataclass(frozen=True, slots=True)
class Moved:
    """Where an owner's frames are instead: a channel, and by how much their ids differ."""

    channel: str
    shift: int = 0


def judge_traffic(owners: Sequence[Owner], heard: Heard, channels: Mapping[str, Sequence[str]]) -> tuple[list[Finding], dict[str, Moved]]:
    """`channels`: the recording's names that belong to each bus of the configuration. Also where each silent owner's frames were found."""
    on_bus = {channel: bus for bus, names in channels.items() for channel in names}
    here = {(on_bus.get(channel), frame_id) for (channel, frame_id), count in heard.items() if count >= FEW}
    silent = [owner for owner in owners if not any((owner.bus, frame_id) in here for frame_id in owner.ids)]
    partly = [owner for owner in owners if owner not in silent and not all((owner.bus, frame_id) in here for frame_id in owner.ids)]
    claimed = {
        (on_bus_channel, frame_id)
        for owner in owners
        if owner not in silent and owner not in partly
        for on_bus_channel in channels.get(owner.bus, ())
        for frame_id in owner.ids
    }
    found: list[Finding] = []
    moved: dict[str, Moved] = {}
    lost_buses = [bus for bus in channels if any(o.bus == bus for o in owners) and all(o in silent for o in owners if o.bus == bus)]
    for owner in silent:
        place = _elsewhere(owner, heard, claimed)
        if place is not None:
            moved[owner.name] = place
            claimed |= {(place.channel, (number + place.shift, extended)) for number, extended in owner.ids}
    for bus in lost_buses:
        theirs = [owner for owner in silent if owner.bus == bus]
        places = {moved[owner.name].channel for owner in theirs if owner.name in moved and not moved[owner.name].shift}
        if len(places) == 1 and (channel := places.pop()) not in on_bus:
            sentence = f"bus '{bus}': its frames are on channel {channel}, none are on the one that the configuration names"
            share = sum(owner.name in moved for owner in theirs) / len(theirs)
            found.append(Finding("wrong_channel", sentence, share, "of its senders", 0.99, "ids", subject=bus))
            silent = [owner for owner in silent if owner not in theirs or moved.get(owner.name) != Moved(channel)]
    for owner in silent:
        found.append(_about(owner, moved.get(owner.name), on_bus))
    for owner in partly:  # some of its ids are another's, or its own others
        place = _elsewhere(owner, heard, claimed)
        if place is not None and place.shift and on_bus.get(place.channel) == owner.bus:
            moved[owner.name] = place
            found.append(_about(owner, place, on_bus))
    return found, moved


def _elsewhere(owner: Owner, heard: Heard, claimed: set[tuple[str, FrameId]]) -> Moved | None:
    """A channel that has all its ids, or has them all moved by the same number: with most of `more`, as often, to a round offset, near."""
    free = {key for key, count in heard.items() if count >= FEW and key not in claimed}
    names = sorted({channel for channel, _ in free})
    for channel in names:
        if all((channel, frame_id) in free for frame_id in owner.ids):
            return Moved(channel)
    if not owner.radar or len(owner.ids) < 2:  # a lone id that is moved can be anything's
        return None
    first, extended = owner.ids[0]
    options = []
    for channel, (number, kind) in free:
        shift = number - first
        if kind == extended and abs(shift) <= FAR and all((channel, (one + shift, kind_)) in free for one, kind_ in owner.ids):
            counts = [heard.get((channel, (one + shift, kind_)), 0) for one, kind_ in (*owner.ids, *owner.more)]
            there = [count for count in counts if count >= FEW]
            even = round(10 * min(there) / max(there))  # what one sender sends in each cycle comes as often
            round_ = (owner.offset + shift) & -(owner.offset + shift) or FAR  # its lowest bit: offsets are round numbers
            options.append((-len(there), -even, -round_, abs(shift), shift, channel))
    return Moved(min(options)[5], min(options)[4]) if options else None


def _about(owner: Owner, place: Moved | None, on_bus: Mapping[str, str]) -> Finding:
    ids = ", ".join(f"0x{number:X}" for number, _ in owner.ids[:4])
    kind = "radar" if owner.radar else "pose" if owner.name == "pose" else "motion"
    what = f"radar {owner.name}" if owner.radar else kind
    radars = (owner.name,) if owner.radar else ()
    subject = "" if owner.radar else owner.name
    if place is None:
        code = f"{kind}_missing"
        sentence = f"{what}: none of its frames ({ids}) was heard, under no id and on no channel that would fit"
        return Finding(code, sentence, 0.0, "frames", 0.95, "ids", radars, subject)
    if place.shift:
        sentence = (
            f"{what}: its frames ({ids}) are not there, but the same pattern {place.shift:+#x} further on, on channel {place.channel}"
        )
        return Finding("wrong_id_offset", sentence, float(place.shift), "ids", 0.9, "ids", radars, subject)
    bus = on_bus.get(place.channel)
    there = f"channel {place.channel}" if bus is None else f"bus '{bus}'"
    sentence = f"{what}: its frames are on {there}, not on bus '{owner.bus}'"
    return Finding("wrong_bus", sentence, 0.0, "", 0.99, "ids", radars, subject)
