"""Quantities out of frames: the DBC's numbers with the profile's units, signs and validity, in SI."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain, combinations, groupby

import numpy as np
from numpy.typing import NDArray

from echogrid.can.database import Message, Ranges, overlap
from echogrid.can.dbc import Dbc
from echogrid.can.decode import BatchDecoder, Payloads, place_of, same_layout
from echogrid.can.profile import Quantity, Valid
from echogrid.core.kernels.assembly import ROW_BYTES
from echogrid.core.kernels.dispatch import loops
from echogrid.core.kernels.frames import GREATEST
from echogrid.core.kernels.plans import MOST_SIGNALS, Plan
from echogrid.core.messages import Floats
from echogrid.errors import EchogridError

PLACE = re.compile(r"\{[nk](:0\dd)?\}")
SPARED = ("rcs",)  # what a detection need not have


class QuantityReader:
    """Reads named quantities from many frames at once, `per_frame` of each from every frame.

    `messages` are the messages numbered from `first_n` on that carry them; their layouts must agree, so that one decoder serves all.
    """

    def __init__(
        self,
        dbc: Dbc,
        messages: Sequence[Message],
        quantities: Mapping[str, Quantity],
        key: str,
        valid: Valid | None = None,
        per_frame: int = 1,
        first_k: int = 1,
        first_n: int = 0,
    ) -> None:
        """Raises EchogridError where a signal is missing or the messages' layouts differ."""
        self.quantities = quantities
        self.per_frame = per_frame
        flags = [flag for q in quantities.values() for flag in (q.valid, q.negative_if) if flag is not None]
        flags += [valid] if valid is not None else []
        needed = [one for name, q in quantities.items() if name not in SPARED for one in (q, q.valid, q.negative_if)]
        self.needed = tuple(dict.fromkeys(one.signal for one in (*needed, valid) if one is not None))  # signals of a whole one
        templates = dict.fromkeys([q.signal for q in quantities.values()] + [flag.signal for flag in flags])
        rows = {template: row for row, template in enumerate(templates)}
        self._compile(rows, valid)
        self._needed = [rows[template] for template in self.needed]
        decoders = []
        for n, message in enumerate(messages, first_n):
            names = [fill(template, key, dbc, n=n, k=k) for template in templates for k in range(first_k, first_k + per_frame)]
            for name in names:
                dbc.signal(message, name, key)
            decoders.append(BatchDecoder(message, names))
        self._decoder = decoders[0]
        for decoder, message in zip(decoders, messages, strict=True):
            if not same_layout(decoder, self._decoder):
                raise EchogridError(
                    f"{dbc.profile}: {key}: in {dbc.path} message '{message.name}' has another layout than '{messages[0].name}', "
                    "expected the same for all"
                )

    def read(self, payloads: Payloads) -> dict[str, Floats]:
        """(N * per_frame,) SI values of each quantity of payloads (N, length or more), frame by frame; NaN where it is absurd or not valid,
        by its own flag or all."""
        return self._read(payloads)[0]

    def read_there(self, payloads: Payloads) -> dict[str, Floats]:
        """As `read`, (M,) values: without those of which a multiplexor leaves out a signal of `needed`."""
        values, there = self._read(payloads)
        whole = there.reshape(len(there), -1, self.per_frame)[:, self._needed].all(axis=1).ravel()
        return values if whole.all() else {name: value[whole] for name, value in values.items()}

    def _read(self, payloads: Payloads) -> tuple[dict[str, Floats], NDArray[np.bool_]]:
        """As `read`, and which signals are there."""
        physical, raw, there = self._decoder.decoded(payloads[:, : self._decoder.length])
        out = np.empty((len(self._plan), len(payloads) * self.per_frame))
        loops.quantities(
            physical, raw, there, self.per_frame, self._plan, self._units, self._flags, self._numbers, self._everywhere, GREATEST, out
        )
        return dict(zip(self.quantities, out, strict=True)), there

    def plan(self, columns: Sequence[str]) -> Plan | None:
        """The same for the loops that read frames as they come, each quantity in the column of its name; None where only `read` can."""
        decoder = self._decoder
        layouts, flags = decoder.layouts, self._flags.tolist()
        if not decoder.is_plain or len(layouts) > MOST_SIGNALS or decoder.length > ROW_BYTES:
            return None
        head = (decoder.length, self.per_frame, self._everywhere, len(layouts), len(self._plan), len(flags), len(self._numbers), 0)
        plan = [(*row, columns.index(name)) for name, row in zip(self.quantities, self._plan.tolist(), strict=True)]
        linear = [(layout.scale, layout.offset) for layout in layouts]
        rows = (*map(place_of, layouts), *plan, *flags, self._numbers.tolist())
        return Plan((*head, *chain.from_iterable(rows)), tuple(map(float, chain(*linear, *self._units.tolist()))))

    def _compile(self, row: Mapping[str, int], valid: Valid | None) -> None:
        """As `loops.quantities` wants it. `row`: of each signal."""
        flags, numbers = list[tuple[int, bool, int, int]](), list[int]()

        def number_of(flag: Valid | None) -> int:
            if flag is None:
                return -1
            one_of, begin = bool(flag.one_of), len(numbers)
            numbers.extend(number for number in flag.one_of or flag.none_of if -(2**63) <= number < 2**63)  # others no signal can be
            flags.append((row[flag.signal], one_of, begin, len(numbers)))
            return len(flags) - 1

        quantities = self.quantities.values()
        plan = [(row[one.signal], number_of(one.valid), number_of(one.negative_if)) for one in quantities]
        self._everywhere = number_of(valid)
        self._plan = np.array(plan, dtype=np.int64).reshape(-1, 3)
        self._units = np.array([(one.factor, one.offset) for one in quantities], dtype=float).reshape(-1, 2)
        self._flags = np.array(flags, dtype=np.int64).reshape(-1, 4)
        self._numbers = np.array(numbers, dtype=np.int64)


def most_in_a_frame(message: Message, whole: Sequence[Sequence[str]]) -> int:
    """Of numbered things (N,), each whole where its signals are there, how many one frame has: less than all where a multiplexor has the
    message in pages, each with the next of them.

    Raises ValueError where they never are whole, or where it does not follow from their number how many frames they take.
    """
    conditions = [_condition(message, names) for names in whole]
    for names, condition in zip(whole, conditions, strict=True):
        if any(_exclude({one}, {other}) for one, other in combinations(condition, 2)):
            raise ValueError(f"{', '.join(names)} found, which are never in one frame, expected all of a detection in one")
    pages = [(condition, len(list(same))) for condition, same in groupby(conditions)]
    apart = [_exclude(one, other) for (one, _), (other, _) in combinations(pages, 2)]
    if not any(apart):
        return len(whole)
    sizes = [size for _, size in pages]
    if not all(apart) or {*sizes[:-1]} != {max(sizes)}:
        found = "frames " + ("that overlap" if not all(apart) else "of " + " and of ".join(map(str, dict.fromkeys(sizes))))
        raise ValueError(f"'{message.name}' is multiplexed, and has its detections in {found}, expected as many in each, in their order")
    return max(sizes)


Condition = frozenset[tuple[str, Ranges]]  # selectors, and what all of these are to be


def _condition(message: Message, names: Sequence[str]) -> Condition:
    """Under which all of those signals are there."""
    found = set[tuple[str, Ranges]]()
    for name in names:
        signals = message.named(name)
        while signals and (selector := signals[0].selected_by) is not None:
            one = selector, tuple(sorted(ids for signal in signals for ids in signal.ids or ()))
            if one in found:
                break
            found.add(one)
            signals = message.named(selector)
    return frozenset(found)


def _exclude(one: Condition | set[tuple[str, Ranges]], other: Condition | set[tuple[str, Ranges]]) -> bool:
    """Whether the two cannot hold in one frame."""
    return any(a == b and not overlap(ids, others) for a, ids in one for b, others in other)


def fill(template: str, key: str, dbc: Dbc, **numbers: int) -> str:
    """A name with its numbers put in."""
    if re.search(r"[{}]", PLACE.sub("", template)):  # Python's formats could ask for the inside of objects, or for gigabytes of blanks
        raise EchogridError(f"{dbc.profile}: {key}: '{template}' is not a name with {{n}} or {{k}} in it, such as {{n:02d}}")
    try:
        return template.format(**numbers)
    except KeyError as error:
        raise EchogridError(f"{dbc.profile}: {key}: '{template}' is not a name with {{n}} or {{k}} in it: {error}") from error
