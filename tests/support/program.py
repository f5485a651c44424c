"""echogrid as a program of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from tests.support.waiting import PATIENCE

PROGRESS = re.compile(r"^INFO echogrid: .*: \d+%\n", re.MULTILINE)  # which depends on how busy the machine is


def echogrid(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs it with warnings as errors."""
    command = [sys.executable, "-W", "error", "-m", "echogrid", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    done.stderr = PROGRESS.sub("", done.stderr)
    return done
