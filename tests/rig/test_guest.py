"""The rig's tests in a guest, where this machine's own kernel has no CAN interfaces to run them on."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from tests.rig import guest, real_bus

HERE = Path(__file__).parent


def test_on_real_can_interfaces() -> None:
    try:
        with real_bus.interfaces():
            pytest.skip("this machine runs test_can.py itself")
    except real_bus.NoInterfacesError as why:
        if not guest.available():
            pytest.skip(f"{why}, and there is no User-Mode Linux; 'make test-rig' installs it, tests/live covers this on virtual buses")
    in_guest(HERE / "test_can.py")


@pytest.mark.skipif(os.environ.get("RIG") != "full", reason="'make test-rig' runs this: it needs minutes, and the Debian package")
def test_under_systemd() -> None:
    in_guest(HERE / "test_systemd.py", systemd=True)


def in_guest(tests: Path, *, systemd: bool = False) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--color=no", "--exitfirst", "--log-cli-level=INFO", str(tests)]
    answer = guest.run(["env", "RIG=guest", *command], systemd=systemd, timeout=900)
    sys.stdout.write(answer.output)  # `make test-rig` shows it
    assert answer.status == 0, answer.output
