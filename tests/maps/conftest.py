"""A stored map for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.stores import three_epochs


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    return three_epochs(tmp_path / "car.egmap")
