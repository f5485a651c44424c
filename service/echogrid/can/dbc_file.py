"""DBC files: messages, signals, multiplexors, floats and long names. Comments, values, nodes and attributes say nothing of the bits
and are passed over, whatever shape they are in.

A line of the kinds that are read may be broken as well: then the message or signal that it was of is marked, and cannot be used.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

from echogrid.can.database import Database, Message, Ranges, Signal

EXTENDED = 1 << 31  # of an id in the file
MOST_STANDARD, MOST_EXTENDED = (1 << 11) - 1, (1 << 29) - 1
NOWHERE = "VECTOR__INDEPENDENT_SIG_MSG"  # holds signals that belong to no message
MOST_SAID = 1000
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")

KEYWORD = re.compile(r"[ \t]*([A-Z_]+)(?![^\s:\"])")
MESSAGE = re.compile(r"BO_\s+(\d{1,10})\s+([^\s:]+)\s*:\s*(\d{1,9})(?!\S)[ \t]*(?:(?!SG_)\S+)?")
SIGNAL = re.compile(
    r"SG_\s+(?P<name>[^\s:]+)(?:\s+(?P<mark>M|m\d{0,10}M?))?\s*:\s*(?P<start>\d{1,9})\s*\|\s*(?P<length>\d{1,9})\s*@\s*(?P<order>[01])\s*"
    r"(?P<sign>[-+])\s*\((?P<scale>[^(),\n]{1,40}),(?P<offset>[^(),\n]{1,40})\)"
    # Limits, unit and receivers say nothing of the bits: as much of them as there is.
    r'\s*(?:\[[^\]\n]*\])?[ \t]*(?:"(?P<unit>(?:[^"\n]|\n(?![ \t]*[A-Z_]+_\b)){0,200})")?(?:[ \t]*[\w.]+(?:\s*,\s*(?!SG_|BO_)[\w.]+)*)?'
)
FLOAT = re.compile(r"SIG_VALTYPE_\s+(\d{1,10})\s+([^\s:]+)(?:\s*:\s*|\s+)([012])\s*;")
BRANCHES = re.compile(r"SG_MUL_VAL_\s+(\d{1,10})\s+(\S+)\s+(\S+)\s+(\d{1,10}\s*-\s*\d{1,10}(?:\s*,\s*\d{1,10}\s*-\s*\d{1,10})*)\s*;")
LONG_NAME = re.compile(r'BA_\s+"System(Message|Signal)LongSymbol"\s+(?:BO_\s+(\d{1,10})|SG_\s+(\d{1,10})\s+(\S+))\s+"([^"\n]*)"\s*;')
OF_A_SIGNAL = re.compile(r"\w+\s+(\d{1,10})\s+([^\s:;]+)")
SIGNAL_NAME = re.compile(r"SG_\s+([^\s:]+)")
MESSAGE_NAME = re.compile(r"BO_\s+(\d+\s+)?([^\s:]+)")
BARE = re.compile(r"\S+[ \t]*(?:\n|\Z)")
MORE = re.compile(r"[ \t]*(?:SG_|BO_)\s")
REST_OF_STRING = re.compile(r'[^"]*"\s*;')


@dataclass
class _Message:
    """A message while its lines are read."""

    name: str
    id: int
    length: int
    signals: list[tuple[Signal, str]] = field(default_factory=list)  # with the mark of multiplexing
    fault: str | None = None
    unread: dict[str, str] = field(default_factory=dict)


def parse(data: bytes) -> Database:
    """The messages of a DBC file in any code page. Nothing is too odd to be read: what is no DBC file has no messages."""
    return _Parser(_text(data)).database()


def number(text: str) -> float | None:
    """An int where it is written as one; None where it is no finite number."""
    text = text.strip()
    if not NUMBER.fullmatch(text):
        return None
    value = float(text)
    if value in (float("inf"), float("-inf")):
        return None
    return int(text) if re.fullmatch(r"[-+]?\d+", text) else value


def _text(data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


class _Parser:
    """Remembers what the lines before said; `open` is the message that a signal's line would belong to."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.at = 0
        self.line = 1
        self.messages: list[_Message] = []
        self.open: _Message | None = None
        self.floats: dict[tuple[int, str], int] = {}
        self.branches: dict[tuple[int, str], tuple[str, Ranges]] = {}
        self.long_names: dict[tuple[int, str | None], str] = {}
        self.broken: dict[tuple[int, str], str] = {}
        self.left_out: list[str] = []

    def database(self) -> Database:
        readers = {"BO_": self._message, "SG_": self._signal, "SIG_VALTYPE_": self._float, "SG_MUL_VAL_": self._branch, "BA_": self._long}
        while self.at < len(self.text):
            begins = KEYWORD.match(self.text, self.at)
            if begins is None:
                self._other()
                continue
            self._go_to(begins.start(1))
            keyword = begins.group(1)
            if keyword not in ("BO_", "SG_"):
                self.open = None
            if keyword not in readers or self._is_bare():
                self._pass_over()
            else:
                readers[keyword]()
        return self._assembled()

    def _go_to(self, position: int) -> None:
        self.line += self.text.count("\n", self.at, position)
        self.at = position

    def _line(self) -> str:
        end = self.text.find("\n", self.at)
        return self.text[self.at : end if end >= 0 else len(self.text)]

    def _is_bare(self) -> bool:
        """A keyword alone on its line is one of the list after NS_."""
        return BARE.match(self.text, self.at) is not None

    def _next_line(self) -> None:
        self._go_to(self.at + len(self._line()) + 1)

    def _after(self, read: re.Match[str] | None) -> None:
        """To what else stands on the line of what was read, if that is of the same kind; of a broken line nothing more is believed."""
        if read is not None:
            self._go_to(read.end())
        if read is None or not MORE.match(self.text, self.at):
            self._next_line()

    def _other(self) -> None:
        """A line without keyword: blank, a remark, or the rest of something."""
        line = self._line().strip()
        if line and not line.startswith("//"):
            self.open = None
        self._next_line()

    def _pass_over(self) -> None:
        """To the next line; where a string goes on over lines and closes its statement, to the end of that."""
        line = self._line()
        self._go_to(self.at + len(line))
        if line.replace('\\"', "").count('"') % 2 and (rest := REST_OF_STRING.match(self.text, self.at)):
            self._go_to(rest.end())
        self._next_line()

    def _leave_out(self, what: str) -> str:
        reason = f"line {self.line}: {what}"
        if len(self.left_out) < MOST_SAID:
            self.left_out.append(reason)
        return reason

    def _message(self) -> None:
        found = MESSAGE.match(self.text, self.at)
        if found is None:
            name = MESSAGE_NAME.match(self.text, self.at)
            reason = self._leave_out("is no BO_ with id, name and length")
            self.open = _Message(name.group(2) if name else "", 0, 0, fault=reason)
        else:
            written, name_, length = int(found.group(1)), found.group(2), int(found.group(3))
            self.open = _Message(name_, written, length)
            identifier, extended = written & ~EXTENDED, bool(written & EXTENDED)
            if name_ != NOWHERE and identifier > (MOST_EXTENDED if extended else MOST_STANDARD):
                expected = "at most 29 bits" if identifier > MOST_EXTENDED else f"11 bits, or {written | EXTENDED} for 29 bits"
                self.open.fault = self._leave_out(f"message '{name_}' has the id {written}, expected one of {expected}")
        if self.open.name and self.open.name != NOWHERE:
            self.messages.append(self.open)
        self._after(found)

    def _signal(self) -> None:
        found = SIGNAL.match(self.text, self.at)
        named = SIGNAL_NAME.match(self.text, self.at)
        name = named.group(1) if named else ""
        scale, offset = (number(found["scale"]), number(found["offset"])) if found else (None, None)
        if self.open is None:
            self._leave_out(f"signal '{name}' belongs to no message")
        elif found is None or scale is None or offset is None:
            reason = self._leave_out(f"the layout of signal '{name}' of message '{self.open.name}' is not understood")
            self.open.unread[name] = reason
        else:
            signal = Signal(
                name,
                int(found["start"]),
                int(found["length"]),
                is_motorola=found["order"] == "0",
                is_signed=found["sign"] == "-",
                scale=scale,
                offset=offset,
                unit=(found["unit"] or "").strip(),
            )
            self.open.signals.append((signal, found["mark"] or ""))
        self._after(found)

    def _float(self) -> None:
        found = FLOAT.match(self.text, self.at)
        if found is None:
            self._broken("SIG_VALTYPE_")
        else:
            self.floats[int(found.group(1)), found.group(2)] = int(found.group(3))
        self._pass_over()

    def _branch(self) -> None:
        found = BRANCHES.match(self.text, self.at)
        if found is None:
            self._broken("SG_MUL_VAL_")
        else:
            ranges = tuple((int(low), int(high)) for low, high in re.findall(r"(\d+)\s*-\s*(\d+)", found.group(4)))
            self.branches[int(found.group(1)), found.group(2)] = found.group(3), ranges
            self._go_to(found.end())
        self._pass_over()

    def _long(self) -> None:
        if found := LONG_NAME.match(self.text, self.at):
            self.long_names[int(found.group(2) or found.group(3)), found.group(4)] = found.group(5)
        self._pass_over()

    def _broken(self, keyword: str) -> None:
        reason = self._leave_out(f"is no {keyword} that is understood")
        if of := OF_A_SIGNAL.match(self.text, self.at):
            self.broken[int(of.group(1)), of.group(2)] = reason

    def _assembled(self) -> Database:
        return Database(tuple(self._whole(message) for message in self.messages), tuple(self.left_out))

    def _whole(self, message: _Message) -> Message:
        unread = {**message.unread, **{name: reason for (id_, name), reason in self.broken.items() if id_ == message.id}}
        selectors = [signal.name for signal, mark in message.signals if mark.endswith("M")]
        signals = []
        for signal, mark in message.signals:
            kind = self.floats.get((message.id, signal.name), 0)
            selected_by, ids = self._selection(message, signal.name, mark, selectors)
            if ids is not None and (selected_by is None or not ids):
                unread.setdefault(signal.name, f"no signal decides when '{signal.name}' is there")
            signals.append(replace(signal, is_float=kind != 0, selected_by=selected_by, ids=ids))
            if kind and signal.length != 32 * kind:
                unread.setdefault(signal.name, f"'{signal.name}' of {signal.length} bits is said to be a float of {32 * kind}")
        name = self.long_names.get((message.id, None), message.name)
        long = {signal.name: self.long_names.get((message.id, signal.name), signal.name) for signal in signals}
        renamed = tuple(replace(s, name=long[s.name], selected_by=long.get(s.selected_by or "", s.selected_by)) for s in signals)
        return Message(
            name,
            message.id & ~EXTENDED,
            bool(message.id & EXTENDED),
            message.length,
            renamed,
            message.fault,
            {long.get(short, short): reason for short, reason in unread.items()},
        )

    def _selection(self, message: _Message, name: str, mark: str, selectors: list[str]) -> tuple[str | None, Ranges | None]:
        """Which signal decides whether one with that mark is there, and by which values; no selector where none or several could."""
        own = tuple((int(n), int(n)) for n in re.findall(r"m(\d+)", mark))
        said = self.branches.get((message.id, name))
        if not mark.startswith("m") and said is None:
            return None, None
        if said is not None:
            # The mark is the first of the ranges, or, with one selector only, one more value of it.
            return said[0], (*own, *said[1]) if selectors == [said[0]] and not mark.endswith("M") else said[1]
        return (selectors[0] if len(selectors) == 1 and selectors[0] != name else None), own
