"""What tests of many parts ask for."""

from __future__ import annotations

import os
import signal

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy comes: arrays are small here, and threads would wait longer than they work

import pytest
from hypothesis import settings

from tests.support.ports import free_port

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as of a job in the background; programs that tests start would not hear Ctrl-C
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("steady", derandomize=True, deadline=None)  # the same examples each time, however busy the machine
settings.register_profile("roaming", max_examples=1000, deadline=None)  # make fuzz
settings.load_profile("steady")


@pytest.fixture
def port() -> int:
    """To listen on, on the loopback."""
    return free_port()


@pytest.fixture
def endpoint(port: int) -> str:
    """Zenoh's name for it."""
    return f"tcp/127.0.0.1:{port}"
