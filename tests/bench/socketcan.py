"""The running service on real CAN interfaces, fed at the buses' pace by this process: its share of a core.

`python -m tests.bench.socketcan [SECONDS]`, as root on a machine with vcan, or in the rig's guest:
`python -m tests.rig.guest env python -m tests.bench.socketcan`. Prints one line of JSON.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

from tests.rig import real_bus
from tests.rig.test_can import running

CPUCLOCK_SCHED = 2  # linux/posix-timers.h


def spent(process: int) -> float:
    """s that another process ran, as the scheduler measured it. /proc counts ticks: who wakes with them is charged more than it took, in
    the rig's guest a third more (a loop that is busy for a fifth of the time: 0.26 by ticks, 0.195 by this)."""
    return time.clock_gettime((~process << 3) | CPUCLOCK_SCHED)


def share(seconds: float) -> dict[str, object]:
    """Of `seconds` of the demo drive, radars and motion on buses of their own."""
    messages = real_bus.drive(seconds)
    with tempfile.TemporaryDirectory() as folder, running(Path(folder), one_bus=False) as service, real_bus.senders() as buses:
        before, begun = spent(service.process.pid), time.monotonic()
        real_bus.play(messages, buses)
        wall, took = time.monotonic() - begun, spent(service.process.pid) - before
        read = len(service.read(messages))
        status = service.status_when(lambda status: status["frames"] >= read)
        service.stop()
    return {
        "share_of_a_core": round(took / wall, 3),
        "late_s": round(wall - seconds, 2),
        "cycles": status["cycles"],
        "latency_ms": status["latency_ms"],
        "rss_mib": round(status["rss_mib"]),
        "overflow": [bus["overflow"] for bus in status["buses"].values()],
    }


if __name__ == "__main__":
    with real_bus.interfaces():
        print(json.dumps(share(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)))
