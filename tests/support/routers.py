"""A Zenoh router as a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

ROUTER = """
import json, sys, zenoh
config = zenoh.Config()
settings = {
    "mode": "router",
    "listen/endpoints": [sys.argv[1]],
    "scouting/multicast/enabled": False,
    "adminspace/enabled": False,
}
for key, value in settings.items():
    config.insert_json5(key, json.dumps(value))
with zenoh.open(config):
    print("up", flush=True)
    sys.stdin.read()
"""


@contextmanager
def router(endpoint: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", ROUTER, endpoint]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "up\n"
            yield process
        finally:
            process.kill()
