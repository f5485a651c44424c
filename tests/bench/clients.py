"""A recording read by programs in another language: `python -m tests.bench.clients`, with Node.js and npm at hand.

@mcap/core and @foxglove/rosmsg2-serialization, of which viewers in browsers are made, decode every message of the demo drive's begin.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections import Counter
from itertools import islice
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from echogrid.commands.replay import replay
from echogrid.logs.drive import Drive, find_drive
from echogrid.logs.log import Log
from echogrid.topics.grids import decode_grid, decode_update
from tests.support import recorded
from tests.support.places import ROOT

PACKAGES = ("@mcap/core@2.2.2", "@foxglove/rosmsg@5.0.5", "@foxglove/rosmsg2-serialization@3.1.0", "fzstd@0.1.1")
FRAMES = 7200  # of the demo drive


def main() -> None:
    """One line: what was read, or why nothing was."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        print("other clients: @mcap/core was not tried, Node.js and npm are not at hand")
        return
    with tempfile.TemporaryDirectory() as folder:
        print(f"other clients: @mcap/core reads {_read_whole(Path(folder))}")


def _read_whole(folder: Path) -> str:
    drive = find_drive(ROOT / "service" / "echogrid" / "demo_drive", None)
    log, recording = folder / "a.log", folder / "a.mcap"
    log.write_bytes(recorded.joined(recorded.candump(list(islice(Log(drive.log), FRAMES)))))
    replay(Drive(drive.config, log, folder / "none.npz"), folder / "out", record=recording)
    subprocess.run(["npm", "install", "--silent", "--no-audit", "--no-fund", *PACKAGES], cwd=folder, check=True, capture_output=True)
    shutil.copy(Path(__file__).parent / "node" / "read.mjs", folder)
    done = subprocess.run(["node", "read.mjs", recording], cwd=folder, check=True, capture_output=True, text=True)
    told = json.loads(done.stdout)
    counts: Counter[str] = Counter()
    sums: Counter[str] = Counter()
    with recording.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            counts[channel.topic] += 1
            if channel.topic in ("/echogrid/map", "/echogrid/map_trinary"):
                sums[channel.topic] += int(decode_grid(message.data).occupancy.sum(dtype=np.int64))
            elif channel.topic == "/echogrid/map_updates":
                sums[channel.topic] += int(decode_update(message.data).occupancy.sum(dtype=np.int64))
    assert {topic: one["messages"] for topic, one in told.items()} == counts
    assert all(told[topic]["sum"] == total for topic, total in sums.items())
    return f"all {sum(counts.values())} messages of {len(counts)} channels, and the same cells"


if __name__ == "__main__":
    main()
