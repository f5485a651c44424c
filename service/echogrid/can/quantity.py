"""Quantities out of frames: the DBC's numbers with the profile's units, signs and validity, in SI."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.can.database import Message
from echogrid.can.dbc import Dbc
from echogrid.can.decode import BatchDecoder, same_layout, stack
from echogrid.can.profile import Quantity, Valid
from echogrid.core.messages import Floats
from echogrid.errors import EchogridError

PLACE = re.compile(r"\{[nk](:0\dd)?\}")
GREATEST = 1e9  # SI units; a larger value is not a measurement, but a float read from garbage


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
        self.valid = valid
        self.per_frame = per_frame
        flags = [flag for q in quantities.values() for flag in (q.valid, q.negative_if) if flag is not None]
        flags += [valid] if valid is not None else []
        templates = dict.fromkeys([q.signal for q in quantities.values()] + [flag.signal for flag in flags])
        self._row = {template: row for row, template in enumerate(templates)}
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

    @np.errstate(over="ignore", invalid="ignore")  # of floats that are garbage
    def read(self, payloads: Sequence[bytes]) -> dict[str, Floats]:
        """(N * per_frame,) SI values of each quantity, frame by frame; NaN where it is absurd or not valid, by its own flag or all."""
        physical, raw_, there_ = self._decoder.decoded(stack(payloads, self._decoder.length))
        values, raw, there = self._by_template(physical), self._by_template(raw_), self._by_template(there_)
        everywhere = None if self.valid is None else self._flagged(self.valid, raw, there)
        out = {}
        for name, quantity in self.quantities.items():
            value = values[self._row[quantity.signal]] * quantity.factor + quantity.offset
            if quantity.negative_if is not None:
                value = np.where(self._flagged(quantity.negative_if, raw, there), -value, value)
            if quantity.valid is not None:
                value[~self._flagged(quantity.valid, raw, there)] = np.nan
            if everywhere is not None:
                value[~everywhere] = np.nan
            value[~(np.abs(value) < GREATEST)] = np.nan
            out[name] = value
        return out

    def _by_template(self, columns: NDArray[Any]) -> NDArray[Any]:
        """(N, columns) to (templates, N * per_frame)."""
        return columns.reshape(-1, len(self._row), self.per_frame).transpose(1, 0, 2).reshape(len(self._row), -1)

    def _flagged(self, flag: Valid, raw: NDArray[np.int64], there: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Where the flag is there and holds."""
        values = raw[self._row[flag.signal]]
        found = np.zeros(values.shape, dtype=np.bool_)
        for number in flag.one_of or flag.none_of:  # numpy's isin takes ten times as long for the few that there are
            found |= values == number
        holds = found if flag.one_of else ~found
        holds &= there[self._row[flag.signal]]
        return holds


def fill(template: str, key: str, dbc: Dbc, **numbers: int) -> str:
    """A name with its numbers put in."""
    if re.search(r"[{}]", PLACE.sub("", template)):  # Python's formats could ask for the inside of objects, or for gigabytes of blanks
        raise EchogridError(f"{dbc.profile}: {key}: '{template}' is not a name with {{n}} or {{k}} in it, such as {{n:02d}}")
    try:
        return template.format(**numbers)
    except KeyError as error:
        raise EchogridError(f"{dbc.profile}: {key}: '{template}' is not a name with {{n}} or {{k}} in it: {error}") from error
