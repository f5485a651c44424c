"""One task a drive: here one after the other, in several processes, or on a Dask cluster; the same files come of it."""

from __future__ import annotations

import multiprocessing
import multiprocessing.process
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

from echogrid.errors import EchogridError
from echogrid.files import sentence
from echogrid.maps.cluster import cluster
from echogrid_training.recording import Track

Job = TypeVar("Job")
Outcome = tuple[bool, str]  # whether it is done, and what is said
AT_ONCE = 64  # tasks of a cluster between two steps of the progress bar


def done(work: Callable[[Job], str], jobs: Sequence[Job], what: str, track: Track, workers: int, scheduler: str | None) -> list[str]:
    """What each job's `work`, a function that processes can be sent, says when it is done. `scheduler`: of Dask, in place of `workers`.

    All are tried. Raises EchogridError with what the first of those that failed say; what is done stays done.
    """
    tried = list(track(_outcomes(partial(_tried, work), jobs, workers, scheduler), what))
    failed = [text for fine, text in tried if not fine]
    if failed:
        count = f"{len(failed)} of {len(jobs)} failed: " if len(jobs) > 1 else ""
        more = f"; and {len(failed) - 3} more" if len(failed) > 3 else ""
        raise EchogridError(f"{count}{'; '.join(failed[:3])}{more}")
    return [text for _, text in tried]


def _tried(work: Callable[[Job], str], job: Job) -> Outcome:
    try:
        return True, work(job)
    except EchogridError as error:
        return False, str(error)
    except OSError as error:
        return False, sentence(error)


def _outcomes(work: Callable[[Job], Outcome], jobs: Sequence[Job], workers: int, scheduler: str | None) -> Iterator[Outcome]:
    """In the jobs' order."""
    if scheduler is not None:
        with cluster(scheduler) as gather:
            for first in range(0, len(jobs), AT_ONCE):
                yield from gather(work, jobs[first : first + AT_ONCE])
        return
    if workers <= 1 or len(jobs) <= 1:
        yield from map(work, jobs)
        return
    with processes(min(workers, len(jobs))) as pool:
        for one in [pool.submit(work, job) for job in jobs]:
            yield one.result()


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """So many, for the block; where that fails, what they are at is the last. They end with this process, a kill included."""
    # Spawned, not forked: a fork of a process with threads may never come up.
    with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"), initializer=_end_with_parent) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _end_with_parent() -> None:
    """In a process of `processes`: without this it would wait for work from a parent that was killed."""
    threading.Thread(target=_leave, args=(multiprocessing.parent_process(),), daemon=True).start()


def _leave(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(1)
