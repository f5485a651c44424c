"""What a compiled loop is given: arrays with something behind them, which is not for it, and arrays that are too short."""

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


class Fenced:
    """A loop's `arguments`, copied: behind each array lies what might belong to it, ones."""

    def __init__(self, arguments: list[Any]) -> None:
        self._behind: list[np.ndarray] = []
        self.arguments = [[self._fenced(array) for array in one] if isinstance(one, list) else self._fenced(one) for one in arguments]

    def _fenced(self, one: Any) -> Any:
        if not isinstance(one, np.ndarray) or not one.flags.c_contiguous:  # a number, or part of another array
            return one
        whole = np.ones((len(one) + 2, *one.shape[1:]), one.dtype)
        whole[: len(one)] = one
        self._behind.append(whole[len(one) :])
        return whole[: len(one)]

    @property
    def is_whole(self) -> bool:
        """Whether nothing was written behind an array."""
        return all((behind == 1).all() for behind in self._behind)
