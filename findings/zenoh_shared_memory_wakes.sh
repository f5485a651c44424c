#!/bin/sh
# A Zenoh session with shared memory, as it is by default, wakes 20 times a second once a client has come and gone, and never did before.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet eclipse-zenoh==1.10.2
cd "$folder"
cat > session.py <<'PYTHON'
import json
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import zenoh

SECONDS = 4


def session(mode: str, ends: str, endpoint: str, shared: bool) -> zenoh.Session:
    config = zenoh.Config()
    settings = {"mode": mode, f"{ends}/endpoints": [endpoint], "scouting/multicast/enabled": False, "transport/shared_memory/enabled": shared}
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def sleeps() -> int:
    """How often threads of this process but the first have gone to sleep so far."""
    tasks = [task for task in Path("/proc/self/task").iterdir() if task.name != str(Path("/proc/self").resolve().name)]
    lines = [line for task in tasks for line in (task / "status").read_text().splitlines()]
    return sum(int(line.split()[1]) for line in lines if line.startswith("voluntary_ctxt_switches"))


def rate() -> float:
    """Of that, a second, while nothing is sent and nobody is connected."""
    time.sleep(1)
    before = sleeps()
    time.sleep(SECONDS)
    return (sleeps() - before) / SECONDS


if sys.argv[1] == "client":
    with session("client", "connect", sys.argv[2], shared=True):
        time.sleep(0.5)
elif sys.argv[1] == "router":
    endpoint, shared = sys.argv[2], sys.argv[3] == "shared"
    with session("router", "listen", endpoint, shared):
        alone = rate()
        subprocess.run([sys.executable, "session.py", "client", endpoint], check=True)
        print(json.dumps({"alone": alone, "after a client": rate()}))
else:
    found = {}
    for number, kind in enumerate(("shared", "not shared")):
        command = [sys.executable, "session.py", "router", f"tcp/127.0.0.1:{17650 + number}", kind]
        found[kind] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        print(f"eclipse-zenoh {version('eclipse-zenoh')}, memory {kind}: wake-ups a second {found[kind]}")
    assert all(found[kind]["alone"] < 5 for kind in found)
    assert found["not shared"]["after a client"] < 5
    assert 15 < found["shared"]["after a client"] < 40
PYTHON
venv/bin/python session.py all
