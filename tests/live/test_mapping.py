"""The thread that maps: what it says of itself where it cannot follow the buses."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import can

from echogrid.can.frame_queue import FrameQueue
from echogrid.config.tables import Publish
from echogrid.core.trust.watch import State
from echogrid.live.mapping import MOST_LAG, Mapping


def test_a_map_that_is_more_than_a_second_behind_the_buses_is_stale() -> None:
    """And it is well again with the first frame that does not have to wait."""
    queue, stop, seconds = FrameQueue(64, lambda bus, message: False), threading.Event(), [MOST_LAG + 0.1, 0.0]
    pipeline = SimpleNamespace(config=SimpleNamespace(publish=Publish()), state=lambda silence_ns: State("degraded", ("radar x: silent",)))
    states: list[State] = []

    def add(bus: str, message: can.Message) -> None:
        time.sleep(seconds.pop(0))

    mapping = Mapping(pipeline, add, queue)  # type: ignore[arg-type]
    thread = threading.Thread(target=mapping.run, args=(stop,))
    thread.start()
    for left in (1, 0):
        queue.put("can0", can.Message())
        while len(seconds) > left:
            time.sleep(0.005)
        with mapping.lock:  # the frame is mapped
            pass
        time.sleep(0.05)
        states.append(mapping.state())
    stop.set()
    thread.join()
    assert states[0].name == "stale"
    assert states[0].reasons[0].startswith("mapping: 1.")
    assert states[0].reasons[0].endswith(" s behind the buses")
    assert states[0].reasons[1] == "radar x: silent"
    assert states[1] == State("degraded", ("radar x: silent",))
