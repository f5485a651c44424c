"""Which messages of a DBC look like the detections of a radar: equal messages that are numbered, and signals that are numbered in one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from echogrid.can.database import Database, Message, Signal
from echogrid.can.quantity import SPARED, most_in_a_frame
from echogrid.surveying.words import detection_role

DIGITS = re.compile(r"\d+")
PLACES = ("range", "azimuth"), ("x", "y")
SPEEDS = ("range_rate",), ("vx", "vy")
MOST_RADARS = 8
FEWEST, MOST = 3, 512  # equal messages, numbered, that are taken for one message each detection
MOST_IN_A_FRAME = 64


@dataclass(frozen=True, slots=True)
class Group:
    """Messages with a radar's detections; names as a profile has them, with {n} and {k} for numbers.

    `messages`: in the order of their numbers. `n`: first and last number, None where one id carries all. `roles`: signal names by quantity.
    """

    name: str
    messages: tuple[Message, ...]
    n: tuple[int, int] | None
    per_frame: int
    first_k: int
    roles: dict[str, str]

    @property
    def ids(self) -> tuple[tuple[int, bool], ...]:
        return tuple((message.frame_id, message.is_extended_frame) for message in self.messages)

    def signal(self, role: str) -> Signal:
        """The first message's (first) signal of a role."""
        name = self.roles[role].format(n=self.n[0] if self.n else 0, k=self.first_k)
        return self.messages[0].named(name)[0]

    @property
    def plain(self) -> list[Signal]:
        """The first message's signals that are no detection's: pages, counters, checksums."""
        used = {self.roles[role].format(n=self.n[0] if self.n else 0, k=k) for role in self.roles for k in self._numbers}
        stems = {DIGITS.sub("#", name) for name in used} if self.per_frame > 1 else set()
        return [s for s in self.messages[0].signals if s.name not in used and DIGITS.sub("#", s.name) not in stems]

    @property
    def in_a_frame(self) -> int:
        """How many of the numbered detections one frame has: a multiplexor may have the message in pages."""
        n, roles = self.n[0] if self.n else 0, [name for role, name in self.roles.items() if role not in SPARED]
        try:
            return most_in_a_frame(self.messages[0], [[name.format(n=n, k=k) for name in roles] for k in self._numbers])
        except ValueError:  # as the profile's reader says in a sentence
            return self.per_frame

    @property
    def _numbers(self) -> range:
        return range(self.first_k, self.first_k + self.per_frame)

    def template(self, name: str) -> str:
        """A plain signal's name as the profile has it."""
        return _with_n(name, self.n[0]) if self.n is not None else name


def groups_of(database: Database) -> list[Group]:
    """All groups whose signals give place and range rate, the fullest first."""
    usable = [message for message in database.messages if message.fault is None and 0 < message.length <= 64]
    found: list[Group] = []
    taken: set[str] = set()
    families = _families(usable)
    for template, numbered in families.items():
        if _numbers_radars(template, numbered, families):
            continue
        group = _family(template, numbered)
        if group is not None and not taken & {message.name for message in group.messages}:
            found.append(group)
            taken |= {message.name for message in group.messages}
    for message in usable:
        if message.name not in taken and (roles := _in_one(message)) is not None:
            found.append(Group(message.name, (message,), None, *roles))
    return found


def _families(messages: Sequence[Message]) -> dict[str, dict[int, Message]]:
    """Messages whose names differ in one number, \\0 in its place, most members first."""
    families: dict[str, dict[int, Message]] = {}
    for message in messages:
        for digits in DIGITS.finditer(message.name):
            template = f"{message.name[: digits.start()]}\0{message.name[digits.end() :]}"
            families.setdefault(template, {})[int(digits.group())] = message
    return dict(sorted(families.items(), key=lambda one: -len(one[1])))


def _numbers_radars(template: str, numbered: dict[int, Message], families: dict[str, dict[int, Message]]) -> bool:
    """Whether the number is the radar's: a few, and another kind of message has the same ones, such as Radar1_Header."""
    if len(numbered) > MOST_RADARS:
        return False
    before = template.split("\0")[0]
    return any(other != template and other.split("\0")[0] == before and families[other].keys() == numbered.keys() for other in families)


def _family(template: str, numbered: dict[int, Message]) -> Group | None:
    """One message for each detection, or for a few, in a row of numbers."""
    first, last = min(numbered), max(numbered)
    if not FEWEST < len(numbered) <= MOST or last - first + 1 != len(numbered):
        return None
    members = tuple(numbered[n] for n in range(first, last + 1))
    own = _in_one(members[0], first)
    if own is None:
        return None
    per_frame, first_k, roles = own
    name = template.replace("\0", _width(template, members[0].name))
    if any(name.format(n=n) != message.name for n, message in numbered.items()):
        return None
    for n, message in numbered.items():
        for role in roles.values():
            for k in range(first_k, first_k + per_frame):
                signals, before = message.named(role.format(n=n, k=k)), members[0].named(role.format(n=first, k=k))
                if len(signals) != 1 or _bits(signals[0]) != _bits(before[0]):
                    return None
    return Group(name, members, (first, last), per_frame, first_k, roles)


def _bits(signal: Signal) -> tuple[object, ...]:
    return signal.start, signal.length, signal.is_motorola, signal.is_signed, signal.scale, signal.offset


def _width(template: str, name: str) -> str:
    """The number's place in a name, as wide as the digits there."""
    at = template.index("\0")
    return _place("n", name[at : len(name) - (len(template) - at - 1)])


def _in_one(message: Message, n: int | None = None) -> tuple[int, int, dict[str, str]] | None:
    """Detections in a frame, the first's number, and signals by role; None where place or range rate is missing."""
    named: dict[str, dict[str, str]] = {}  # role, template or name -> by template, names
    numbers: dict[str, set[int]] = {}
    for signal in message.signals:
        role = detection_role(signal)
        if role is None or signal.name in message.unread or (signal.is_float and signal.length not in (32, 64)):
            continue
        template = _with_k(signal.name, n)
        named.setdefault(role, {}).setdefault(template, signal.name)
        if "{k" in template:
            numbers.setdefault(template, set()).add(_k_of(signal.name, n))
    many = {
        template: sorted(found) for template, found in numbers.items() if len(found) > 1 and found == set(range(min(found), max(found) + 1))
    }
    rows = {(found[0], len(found)) for found in many.values()}
    for first_k, per_frame in sorted(rows, key=lambda row: -row[1]):
        roles = {
            role: template
            for role, templates in named.items()
            for template in reversed(templates)
            if many.get(template, []) == list(range(first_k, first_k + per_frame))
        }
        if per_frame <= MOST_IN_A_FRAME and (kept := _enough(roles)) is not None:
            return per_frame, first_k, kept
    single = {
        role: _with_n(next(iter(templates.values())), n)
        for role, templates in named.items()
        if not any(template in many for template in templates)
    }
    kept = _enough(single)
    return None if kept is None else (1, 1, kept)


def _enough(roles: dict[str, str]) -> dict[str, str] | None:
    """One kind of place and one of speed, and what else there is; None where one of them is missing."""
    place = next((keys for keys in PLACES if all(key in roles for key in keys)), None)
    speed = next((keys for keys in SPEEDS if all(key in roles for key in keys)), None)
    if place is None:
        return None
    kept = [*place, *(speed or ()), *(key for key in ("rcs", "valid") if key in roles)]
    if speed is not None:
        return {key: roles[key] for key in kept}
    if "vx" not in roles:
        return None
    return {"range_rate" if key == "vx" else key: roles[key] for key in [*place, "vx", *kept[len(place) :]]}


def _with_k(name: str, n: int | None) -> str:
    """With {k} for the last of its numbers that is not the message's."""
    found = list(DIGITS.finditer(name))
    if not found:
        return name
    last = found[-1]
    if n is not None and len(found) > 1 and int(last.group()) == n:
        last = found[-2]
    elif n is not None and int(last.group()) == n and len(found) == 1:
        return _with_n(name, n)
    before = _with_n(name[: last.start()], n) if n is not None else name[: last.start()]
    return f"{before}{_place('k', last.group())}{name[last.end() :]}"


def _k_of(name: str, n: int | None) -> int:
    found = [int(digits.group()) for digits in DIGITS.finditer(name)]
    return found[-2] if n is not None and len(found) > 1 and found[-1] == n else found[-1]


def _with_n(name: str, n: int | None) -> str:
    """With {n} for a number that is the message's."""
    if n is None:
        return name
    for digits in reversed(list(DIGITS.finditer(name))):
        if int(digits.group()) == n:
            return f"{name[: digits.start()]}{_place('n', digits.group())}{name[digits.end() :]}"
    return name


def _place(letter: str, digits: str) -> str:
    return f"{{{letter}:0{len(digits)}d}}" if len(digits) > 1 and digits[0] == "0" else f"{{{letter}}}"
