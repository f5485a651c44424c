"""The thread that maps: what it says of itself where it cannot follow the buses."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace

import can
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.waiting import until

from echogrid.can.intake.frames import FrameBatch
from echogrid.config.tables import Publish
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.mapper import MapUpdate
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.trust.watch import State
from echogrid.live.mapping import MOST_LAG, Mapping
from echogrid.live.receiving import Receiving


def without_buses() -> Receiving:
    """Whose queue is filled by the tests."""
    return Receiving(SimpleNamespace(are_motion=lambda bus, batch: np.zeros(len(batch), bool)))  # type: ignore[arg-type]


def test_a_map_that_is_more_than_a_second_behind_the_buses_is_stale() -> None:
    """And it is well again with the first frame that does not have to wait."""
    receiving = without_buses()
    stop, seconds = threading.Event(), [MOST_LAG + 0.1, 0.0]
    pipeline = SimpleNamespace(
        config=SimpleNamespace(publish=Publish()),
        mapper=None,
        signals=SimpleNamespace(number=lambda bus: 0, newest_ns=None),
        state=lambda silence_ns: State("degraded", ("radar x: silent",)),
    )
    states: list[State] = []

    def take(batch: FrameBatch, buses: NDArray[np.int64]) -> Iterator[tuple[int, MapUpdate | None]]:
        time.sleep(seconds.pop(0))
        yield from ()

    mapping = Mapping(pipeline, take, receiving)  # type: ignore[arg-type]
    thread = threading.Thread(target=mapping.run, args=(stop,))
    thread.start()
    for left in (1, 0):
        receiving.queue.put("can0", FrameBatch.of([can.Message()]), time.monotonic())
        while len(seconds) > left and thread.is_alive():
            time.sleep(0.005)
        time.sleep(0.05)
        with mapping.lock:  # the frame is mapped
            states.append(mapping.state())
    stop.set()
    thread.join()
    assert states[0].name == "stale"
    assert states[0].reasons[0].startswith("mapping: 1.")
    assert states[0].reasons[0].endswith(" s behind the buses")
    assert states[0].reasons[1] == "radar x: silent"
    assert states[1] == State("degraded", ("radar x: silent",))


@pytest.mark.parametrize("comes", [False, True])
def test_the_newest_map_goes_out_though_nobody_listened(comes: bool) -> None:
    """To who comes, at once; for who comes later, when nothing newer does."""
    receiving, stop = without_buses(), threading.Event()
    mapper = SimpleNamespace(map=OccupancyMap(GridSpec(16, 0.25)), epoch=0, certainty=lambda ego: None)
    signals = SimpleNamespace(number=lambda bus: 0, newest_ns=None)
    pipeline = SimpleNamespace(config=SimpleNamespace(publish=Publish()), mapper=mapper, signals=signals)
    updates = [MapUpdate(EgoState(50_000_000 * n, SE2(0.0, 0.0, 0.0), 0.0, 0.0), np.zeros((0, 2))) for n in range(5)]
    left = list(updates)

    def take(batch: FrameBatch, buses: NDArray[np.int64]) -> Iterator[tuple[int, MapUpdate | None]]:
        yield 1, left.pop(0) if left else None

    mapping, told, listening = Mapping(pipeline, take, receiving), list[MapUpdate](), threading.Event()  # type: ignore[arg-type]
    mapping.listened = listening.is_set
    thread = threading.Thread(target=mapping.run, args=(stop,))
    thread.start()
    for n in range(80):
        if n < 5 or comes:  # frames that complete nothing
            receiving.queue.put("can0", FrameBatch.of([can.Message()]), time.monotonic())
        if n < 5:
            until(lambda there=4 - n: len(left) == there)  # type: ignore[misc]
        if n == 20 and comes:
            listening.set()
        if (snapshot := mapping.outbox.get(timeout=0.01)) is not None:
            told.append(snapshot.update)
    stop.set()
    thread.join()
    assert told == [updates[0], updates[-1]]


def test_what_several_buses_had_at_one_time_is_mapped_in_the_order_of_its_times() -> None:
    """As a recording of them has it, whichever was read first."""
    receiving, stop = without_buses(), threading.Event()
    signals = SimpleNamespace(number=["radars", "chassis"].index, newest_ns=None)
    pipeline = SimpleNamespace(config=SimpleNamespace(publish=Publish()), mapper=None, signals=signals)
    taken: list[tuple[list[float], list[int]]] = []

    def take(batch: FrameBatch, buses: NDArray[np.int64]) -> Iterator[tuple[int, MapUpdate | None]]:
        taken.append((batch.stamps.tolist(), buses.tolist()))
        stop.set()
        yield from ()

    for bus, stamps in (("radars", (1.0, 3.0)), ("chassis", (0.5, 2.0, 3.5))):
        receiving.queue.put(bus, FrameBatch.of([can.Message(timestamp=stamp, channel=bus) for stamp in stamps]), time.monotonic())
    Mapping(pipeline, take, receiving).run(stop)  # type: ignore[arg-type]
    assert taken == [([0.5, 1.0, 2.0, 3.0, 3.5], [1, 0, 1, 0, 1])]
