"""An existing Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from echogrid.errors import EchogridError

PATIENCE = 10.0  # s that the scheduler is waited for

Gather = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # work on jobs, in their order


@contextmanager
def cluster(scheduler: str) -> Iterator[Gather]:
    """What carries a batch of jobs out on the workers of a scheduler, given by its address, and returns results in the jobs' order.

    Raises EchogridError where distributed is not installed, no scheduler answers, or a worker fails; what a job raises of its own as it is.
    """
    try:
        from distributed import Client
    except ImportError:
        raise EchogridError("--scheduler: distributed is not installed: pip install distributed") from None
    try:
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)  # type: ignore[no-untyped-call]  # it has no types
    except (OSError, ValueError) as error:
        raise EchogridError(f"{scheduler}: no Dask scheduler answers there within {PATIENCE:g} s: {error}") from error

    def gather(work: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
        try:
            # distributed has no types.
            results: list[Any] = client.gather(client.map(work, jobs, pure=False))  # type: ignore[no-untyped-call]
        except EchogridError:
            raise
        except Exception as error:  # whatever a worker met: no echogrid, another one, no memory
            raise EchogridError(
                f"{scheduler}: a worker failed: {type(error).__name__}: {error}; all need this version of echogrid"
            ) from error
        return results

    with client:
        yield gather
