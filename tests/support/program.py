"""echogrid as a program of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.support.waiting import PATIENCE


def echogrid(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs it with warnings as errors."""
    command = [sys.executable, "-W", "error", "-m", "echogrid", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
