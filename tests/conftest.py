"""What tests of many parts ask for."""

from __future__ import annotations

import pytest

from tests.ports import free_port


@pytest.fixture
def port() -> int:
    """To listen on, on the loopback."""
    return free_port()


@pytest.fixture
def endpoint(port: int) -> str:
    """Zenoh's name for it."""
    return f"tcp/127.0.0.1:{port}"
