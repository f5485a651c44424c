"""Work in several processes: they end with the one that asked for it, however that ends."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.places import ROOT
from tests.support.waiting import PATIENCE, until

WORK = """
import time
from echogrid_training.tasks import processes
with processes(2) as pool:
    for one in [pool.submit(time.sleep, 0) for _ in range(4)]:
        one.result()
    busy = pool.submit(time.sleep, 600)
    print(*pool._processes, flush=True)
    busy.result()
"""


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no /proc")
def test_a_kill_leaves_no_process_running() -> None:
    """One of them at work, one waiting for it."""
    with subprocess.Popen([sys.executable, "-c", WORK], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = [int(word) for word in parent.stdout.readline().split()]
        assert len(workers) == 2
        assert all(running(pid) for pid in workers)
        parent.send_signal(signal.SIGKILL)
        assert parent.wait(PATIENCE) == -signal.SIGKILL
    until(lambda: not any(running(pid) for pid in workers))


def running(pid: int) -> bool:
    """What has ended but has no parent that asks for it counts as ended."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_there_is_one_way_to_several_processes() -> None:
    sources = (ROOT / "training").rglob("*.py")
    assert [path.name for path in sources if re.search(r"ProcessPoolExecutor\(|multiprocessing\.(Pool|Process)\(", path.read_text())] == [
        "tasks.py"
    ]
