"""Frames per second out of recordings: the service's readers beside python-can's, by turns in one run, of the demo drive's frames."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import can

from echogrid.logs.log import Log
from tests.support import recorded

TURNS = 5
THEIRS: dict[str, Callable[[Path], Iterable[Any]]] = {
    ".log": can.CanutilsLogReader,
    ".asc": can.ASCReader,
    ".blf": can.BLFReader,
    ".trc": can.TRCReader,
    ".csv": can.CSVReader,
    "relative .asc": can.ASCReader,
}


def reading(log: Path) -> dict[str, tuple[float, float]]:
    """By format: thousands of frames per second of processor time, ours and python-can's; medians."""
    messages = [_message(message) for message in Log(log)]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for suffix, theirs in THEIRS.items():
            path = Path(folder) / f"a{suffix}"
            if suffix == ".trc":  # python-can writes no CAN FD there
                path.write_bytes(recorded.joined(recorded.trc(messages)))
            elif suffix == "relative .asc":  # nor relative times
                path.write_bytes(recorded.joined(recorded.asc(messages, "relative")))
            else:
                recorded.by_python_can(path, messages)
            turns = [(_rate(_ours, path, len(messages)), _rate(_one_by_one(theirs), path, len(messages))) for _ in range(TURNS)]
            ours, others = (statistics.median(rates) for rates in zip(*turns, strict=True))
            found[suffix] = ours, others
    return found


def _message(frame: can.Message) -> can.Message:
    return can.Message(
        timestamp=frame.timestamp,
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.is_extended_id,
        channel=frame.channel,
        data=frame.data,
        is_fd=frame.is_fd,
        bitrate_switch=frame.bitrate_switch,
    )


def _ours(path: Path) -> Iterator[int]:
    """As a replay takes them."""
    return map(len, Log(path).batches())


def _one_by_one(reader: Callable[[Path], Iterable[Any]]) -> Callable[[Path], Iterator[int]]:
    return lambda path: (1 for _ in reader(path))


def _rate(counts: Callable[[Path], Iterator[int]], path: Path, expected: int) -> float:
    start = time.process_time()
    count = sum(counts(path))
    spent = time.process_time() - start
    assert count == expected
    return count / spent / 1e3
