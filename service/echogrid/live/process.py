"""What the process is told of its memory and its threads: at its begin, and when the start is over."""

from __future__ import annotations

import ctypes
import gc
import sys
from typing import Any

from echogrid.can import dbc

SWITCH = 0.0005  # s: after so long a thread gives way to one that waits; Python's own 5 ms would be longer than a map update
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # of malloc.h
OF_ITS_OWN = 2 << 20  # bytes from which on a piece of memory goes back as soon as it is not needed; all of a cycle's are smaller
KEPT = 4 << 20  # bytes that are not needed at the heap's end, and stay all the same: what a cycle takes is taken again by the next


def begin() -> None:
    """Before anything large is loaded: glibc would else take the largest piece so far for the measure, and keep all smaller ones, and have
    a store of its own for each thread."""
    tell = _of_the_c_library("mallopt")
    if tell is not None:
        tell(M_MMAP_THRESHOLD, OF_ITS_OWN)
        tell(M_TRIM_THRESHOLD, KEPT)
        tell(M_ARENA_MAX, 1)


def settle() -> None:
    """Once the model is chosen, before the service runs: what the start took goes back, and threads wait less for each other."""
    sys.setswitchinterval(SWITCH)
    dbc.forget()
    gc.collect()
    gc.freeze()  # what is there now stays: it need not be looked through again
    give_back = _of_the_c_library("malloc_trim")
    if give_back is not None:
        give_back(0)


def _of_the_c_library(name: str) -> Any:
    """A function of glibc's; other libraries give memory back by rules of their own: None."""
    return getattr(ctypes.CDLL(None), name, None)
