"""The running service on real CAN interfaces, fed at the buses' pace by this process: its share of a core, and of that its threads'.

`python -m tests.bench.socketcan [SECONDS]`, as root on a machine with vcan, or in the rig's guest:
`python -m tests.rig.guest env python -m tests.bench.socketcan`. Prints one line of JSON.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

from tests.rig import real_bus
from tests.rig.test_can import running

TICK = os.sysconf("SC_CLK_TCK")


def spent(process: int) -> dict[str, tuple[float, float]]:
    """By thread: s in user and in system mode."""
    found = {}
    for task in Path(f"/proc/{process}/task").iterdir():
        fields = (task / "stat").read_text().rpartition(")")[2].split()
        found[task.name] = int(fields[11]) / TICK, int(fields[12]) / TICK
    return found


def share(seconds: float) -> dict[str, object]:
    """Of `seconds` of the demo drive, radars and motion on buses of their own."""
    messages = real_bus.drive(seconds)
    with tempfile.TemporaryDirectory() as folder, running(Path(folder), one_bus=False) as service, real_bus.senders() as buses:
        before, begun = spent(service.process.pid), time.monotonic()
        real_bus.play(messages, buses)
        wall, after = time.monotonic() - begun, spent(service.process.pid)
        read = len(service.read(messages))
        status = service.status_when(lambda status: status["frames"] >= read)
        service.stop()
    threads = {task: [now - then for now, then in zip(after[task], before.get(task, (0.0, 0.0)), strict=True)] for task in after}
    user, system = (sum(one[n] for one in threads.values()) / wall for n in range(2))
    return {
        "share_of_a_core": round(user + system, 3),
        "user": round(user, 3),
        "system": round(system, 3),
        "threads": sorted((round(sum(one) / wall, 3) for one in threads.values()), reverse=True)[:6],
        "late_s": round(wall - seconds, 2),
        "cycles": status["cycles"],
        "latency_ms": status["latency_ms"],
        "rss_mib": round(status["rss_mib"]),
        "overflow": [bus["overflow"] for bus in status["buses"].values()],
    }


if __name__ == "__main__":
    with real_bus.interfaces():
        print(json.dumps(share(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)))
