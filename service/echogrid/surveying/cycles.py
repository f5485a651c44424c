"""How a radar's frames are put together to a cycle: which message is the header, what it counts, which is last, what numbers the pages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import can

from echogrid.can.database import FrameId, Message, Signal
from echogrid.surveying.counting import SURE, checksum_of, counter_of, integers, raw, sums
from echogrid.surveying.groups import Group
from echogrid.surveying.heard import Channel
from echogrid.surveying.words import is_count, tokens

AGREES = 0.7  # share of the cycles that must be as said; frames get lost
LEAST_CYCLES = 8
ALIKE = 1.5  # how many times as many frames as cycles a companion may have
PAGES = 0.9


@dataclass(frozen=True, slots=True)
class Shape:
    """Names as a profile has them. `frames`: in every cycle, where no header counts them. `agrees`: share of the cycles that are so."""

    agrees: float
    header: Message | None = None
    count: tuple[str, ...] = ()
    cycle: str | None = None
    frames: int | None = None
    ends_with: str | None = None
    page: str | None = None
    detections_cycle: str | None = None
    cycle_bits: int | None = None
    frame_crc: tuple[str, str] | None = None  # signal, algorithm
    crc: tuple[str, str, str] | None = None  # message, signal, algorithm


@dataclass(frozen=True, slots=True)
class _Split:
    """The traffic cut at each frame of a companion: `heads` its frames, `after` those of detections up to its next one."""

    message: Message
    heads: list[can.Message]
    after: list[list[can.Message]]

    @property
    def comes_first(self) -> bool:
        """Whether detections follow it sooner than it follows them."""
        first = [a[0].timestamp - h.timestamp for h, a in zip(self.heads, self.after, strict=True) if a]
        last = [h.timestamp - a[-1].timestamp for h, a in zip(self.heads[1:], self.after, strict=False) if a]
        return sorted(first)[len(first) // 2] <= sorted(last)[len(last) // 2] if first and last else True


def shape_of(group: Group, channel: Channel, shift: int, companions: Sequence[Message]) -> Shape | None:
    """Of the group's messages with their ids shifted, by the frames of a channel. None where no cycle can be made out."""
    ids = [moved(message, shift) for message in group.messages]
    splits = [split for message in companions if (split := _split(message, ids, channel, shift)) is not None]
    shapes = [(_rank(shape, split.message, group), shape, split) for split in splits for shape in _with_header(split, group)]
    if not shapes:
        return _without_header(group, channel, ids)
    _, best, split = max(shapes, key=lambda one: one[0])
    return _detailed(best, split, group, splits)


def moved(message: Message, shift: int) -> FrameId:
    return message.frame_id + shift, message.is_extended_frame


def _split(message: Message, ids: Sequence[FrameId], channel: Channel, shift: int) -> _Split | None:
    own = moved(message, shift)
    if not channel.has(own) or channel.lengths[own] < message.length:
        return None
    heads: list[can.Message] = []
    after: list[list[can.Message]] = []
    for frame in channel.of([own, *ids]):
        if (frame.arbitration_id, frame.is_extended_id) == own:
            heads.append(frame)
            after.append([])
        elif heads:
            after[-1].append(frame)
    heads, after = heads[:-1], after[:-1]  # the last cycle may be cut off
    used = sum(bool(frames) for frames in after)
    if used < LEAST_CYCLES or len(heads) > ALIKE * used:
        return None
    return _Split(message, heads, after)


def _with_header(split: _Split, group: Group) -> list[Shape]:
    """The readings that this companion allows as a header."""
    numbers = [len(frames) for frames in split.after]
    named = [s for s in integers(split.message) if is_count(s)]
    others = [s for s in integers(split.message) if s not in named and 4 <= s.length <= 16]
    sums = [(s,) for s in named] + [(a, b) for n, a in enumerate(named) for b in named[:n]] + [(s,) for s in others]
    payloads = [bytes(head.data) for head in split.heads]
    shapes, each = [], group.in_a_frame
    usual, often = Counter(numbers).most_common(1)[0]
    constant = often / len(numbers)
    for signals in sums:
        wanted = [-(-sum(values) // each) for values in zip(*(raw(s, payloads) for s in signals), strict=True)]
        if len(set(wanted)) == 1 and signals[0] in others:
            continue  # a constant that happens to fit
        names = tuple(s.name for s in signals)
        first = _share(wanted, numbers)
        last = _share(wanted[1:], numbers[:-1])
        if first >= AGREES and (first > last or split.comes_first):
            shapes.append(Shape(first, split.message, names))
        elif last >= AGREES:
            shapes.append(Shape(last, split.message, names, ends_with=split.message.name))
    if not shapes and constant >= AGREES and usual:
        count = tuple(s.name for s in named[:1] if max(raw(s, payloads)) <= usual * each and len(set(raw(s, payloads))) > 1)
        end = None if split.comes_first else split.message.name
        shapes.append(Shape(constant, split.message, count, frames=usual, ends_with=end))
    return shapes


def _share(one: Sequence[int], other: Sequence[int]) -> float:
    return sum(a == b for a, b in zip(one, other, strict=True)) / max(len(one), 1)


def _rank(shape: Shape, message: Message, group: Group) -> tuple[float, ...]:
    """A header that counts before one that does not; then how well; then how much of its name it shares with the detections."""
    own, theirs = tokens(message.name), tokens(group.messages[0].name)
    common = sum(word in theirs for word in own) / max(len(own), 1)
    counts = bool(shape.count) and shape.frames is None
    return float(counts), round(shape.agrees, 1), float(any(is_count(s) for s in message.signals)), common, shape.agrees


def _detailed(shape: Shape, split: _Split, group: Group, splits: Sequence[_Split]) -> Shape:
    """With counters, pages and checksums."""
    payloads = [bytes(head.data[: split.message.length]) for head in split.heads]
    cycle = counter_of(split.message, payloads, widest=True)
    first = shape.ends_with is None
    cycles = split.after if first else [[], *split.after[:-1]]
    page = None if group.n is not None else _page(group, cycles)
    own, bits = (None, None) if cycle is None else _own_cycle(group, cycles, raw(cycle, payloads), cycle, page)
    frame_crc = _frame_crc(group, cycles)
    crc = None if frame_crc else _cycle_crc(split, group, cycles, payloads, splits, page)
    return Shape(
        shape.agrees,
        shape.header,
        shape.count,
        cycle.name if cycle else None,
        shape.frames,
        shape.ends_with,
        page.name if page else None,
        own,
        bits,
        frame_crc,
        crc,
    )


def _page(group: Group, cycles: Sequence[Sequence[can.Message]]) -> Signal | None:
    """What numbers the frames of a cycle, from 0 or 1 on: it rises in every cycle, and most begin with the same number."""
    many = [frames for frames in cycles if len(frames) > 1]
    scored = []
    for signal in [s for s in group.plain if s in integers(group.messages[0])]:
        told = [raw(signal, _payloads(frames, group)) for frames in many]
        rising = sum(all(a < b for a, b in pairwise(one)) for one in told) / max(len(told), 1)
        begins = max((sum(one[0] == begin for one in told) / max(len(told), 1) for begin in (0, 1)), default=0.0)
        if rising >= PAGES and begins >= AGREES:
            scored.append((round(begins, 2), -signal.length, signal.name, signal))
    return max(scored)[-1] if scored else None


def _payloads(frames: Sequence[can.Message], group: Group) -> list[bytes]:
    length = group.messages[0].length
    return [bytes(frame.data[:length]).ljust(length, b"\0") for frame in frames]


def _own_cycle(
    group: Group, cycles: Sequence[Sequence[can.Message]], numbers: Sequence[int], counter: Signal, page: Signal | None
) -> tuple[str | None, int | None]:
    """The detection frames' signal that repeats the header's counter, and how many of its low bits, None: all."""
    found = []
    for signal in [s for s in group.plain if s in integers(group.messages[0]) and s != page and 2 <= s.length <= counter.length]:
        mask = (1 << signal.length) - 1
        pairs = [
            (value, number & mask)
            for frames, number in zip(cycles, numbers, strict=True)
            for value in raw(signal, _payloads(frames, group))
        ]
        share = sum(a == b for a, b in pairs) / max(len(pairs), 1)
        if share >= PAGES and len({b for _, b in pairs}) > 2:
            found.append((signal.length, share, signal))
    if not found:
        return None, None
    length, _, signal = max(found, key=lambda one: one[:2])
    return group.template(signal.name), None if length == counter.length else length


def _frame_crc(group: Group, cycles: Sequence[Sequence[can.Message]]) -> tuple[str, str] | None:
    frames = [frame for frames in cycles for frame in frames]
    found = checksum_of(group.messages[0], _payloads(frames[:: max(len(frames) // 40, 1)], group)) if frames else None
    return None if found is None else (group.template(found[0].name), found[1])


def _cycle_crc(
    split: _Split,
    group: Group,
    cycles: Sequence[Sequence[can.Message]],
    payloads: Sequence[bytes],
    splits: Sequence[_Split],
    page: Signal | None,
) -> tuple[str, str, str] | None:
    """A checksum over header and detection frames, in the header or in a message after them."""
    order = {message.frame_id: n for n, message in enumerate(group.messages)}
    lowest = min(order)

    def joined(frames: Sequence[can.Message]) -> bytes:
        base = min(frame.arbitration_id for frame in frames) if frames else lowest
        data = _payloads(frames, group)
        if page is not None:
            return b"".join(payload for _, payload in sorted(zip(raw(page, data), data, strict=True)))
        return b"".join(
            payload for _, payload in sorted(zip([f.arbitration_id - base for f in frames], data, strict=True), key=lambda one: one[0])
        )

    usual = [n for n, frames in enumerate(cycles) if frames]
    summed = {n: joined(cycles[n]) for n in usual}
    found = checksum_of(split.message, [payloads[n] for n in usual], [summed[n] for n in usual])
    if found is not None:
        return split.message.name, found[0].name, found[1]
    for other in splits:
        if other.message.name == split.message.name or other.comes_first:
            continue
        ends = {head.timestamp: bytes(head.data[: other.message.length]) for head in other.heads}
        times = sorted(ends)
        pairs = []
        for n in usual:
            last = cycles[n][-1].timestamp
            end = next((time for time in times if time >= last), None)
            if end is not None:
                pairs.append((ends[end], payloads[n] + summed[n]))
        alone = sums(other.message, pairs)
        if alone is not None:
            return other.message.name, *alone
    return None


def _without_header(group: Group, channel: Channel, ids: Sequence[FrameId]) -> Shape | None:
    """Equal numbers of frames in every cycle: the last id before the numbers begin again ends it."""
    if group.n is None:
        return None
    place = {frame_id: n for n, frame_id in enumerate(ids)}
    runs: list[list[int]] = [[]]
    for frame in channel.of(ids):
        n = place[frame.arbitration_id, frame.is_extended_id]
        if n in runs[-1]:
            runs.append([])
        runs[-1].append(n)
    runs = runs[1:-1]
    if len(runs) < LEAST_CYCLES:
        return None
    (number, last), often = Counter((len(run), run[-1]) for run in runs).most_common(1)[0]
    agrees = often / len(runs)
    return Shape(agrees, frames=number, ends_with=group.messages[last].name) if agrees >= SURE else None
