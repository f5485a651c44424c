"""kill -9 while a map is being written; `python -m tests.endurance kill` does it 200 times."""

from __future__ import annotations

from pathlib import Path

from tests.endurance.kill import kills


def test_a_killed_process_leaves_a_file_that_opens_with_all_it_had_written(tmp_path: Path) -> None:
    """Each child is held to what it said (see tests/endurance/kill.py); between them they said something."""
    results = kills(tmp_path, times=10, seed=1)
    assert sum(one.said or 0 for one in results) > 50
