"""A drive past posts, recorded without noise: where everything stands is known."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.posts_drive import posts_drive


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive folder of 15 m between two rows of posts."""
    return posts_drive(tmp_path_factory.mktemp("own") / "street")
