"""Quantities out of frames: the DBC's numbers with the profile's units, signs and validity, in SI."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from echogrid.can.database import Message
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
        templates = dict.fromkeys([q.signal for q in quantities.values()] + [flag.signal for flag in flags])
        self._compile({template: row for row, template in enumerate(templates)}, valid)
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
        physical, raw, there = self._decoder.decoded(payloads[:, : self._decoder.length])
        out = np.empty((len(self._plan), len(payloads) * self.per_frame))
        loops.quantities(
            physical, raw, there, self.per_frame, self._plan, self._units, self._flags, self._numbers, self._everywhere, GREATEST, out
        )
        return dict(zip(self.quantities, out, strict=True))

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


def fill(template: str, key: str, dbc: Dbc, **numbers: int) -> str:
    """A name with its numbers put in."""
    if re.search(r"[{}]", PLACE.sub("", template)):  # Python's formats could ask for the inside of objects, or for gigabytes of blanks
        raise EchogridError(f"{dbc.profile}: {key}: '{template}' is not a name with {{n}} or {{k}} in it, such as {{n:02d}}")
    try:
        return template.format(**numbers)
    except KeyError as error:
        raise EchogridError(f"{dbc.profile}: {key}: '{template}' is not a name with {{n}} or {{k}} in it: {error}") from error
