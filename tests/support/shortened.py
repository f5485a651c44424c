"""Which arrays of a loop's arguments may be shorter than the others say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np


def taken_shorter(loop: Callable[..., None], arguments: list[Any]) -> set[tuple[int, int]]:
    """Those (place, axis) along which an array may be one shorter, axis -1 of a list of them; of all others the loop says that they do not
    belong together."""
    taken = set()
    for place, axis, shorter in _one_shorter(arguments):
        try:
            loop(*shorter)
        except ValueError:
            continue
        taken.add((place, axis))
    return taken


def _one_shorter(arguments: list[Any]) -> Iterator[tuple[int, int, list[Any]]]:
    """Each array along each of its axes, and each list of them by its last and in its first. What is behind is still there: a loop that
    does not notice reads nothing that is not."""
    for place, one in enumerate(arguments):
        first, *rest = one if isinstance(one, list) else [one]
        if isinstance(one, list):
            yield place, -1, [*arguments[:place], one[:-1], *arguments[place + 1 :]]
        for axis in range(np.ndim(first)):
            cut = first[(slice(None),) * axis + (slice(-1),)]
            yield place, axis, [*arguments[:place], [cut, *rest] if isinstance(one, list) else cut, *arguments[place + 1 :]]
