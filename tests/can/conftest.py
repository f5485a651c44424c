"""DBC files of real cars and sensors."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def vendor_dbc(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Where a DBC file of the package opendbc lies, by its name; also one that the package puts together of parts."""
    if sys.version_info >= (3, 13):
        pytest.skip("opendbc, whose DBC files this reads, refuses Python 3.13")
    import opendbc

    folder = tmp_path_factory.mktemp("dbc")
    for name, text in opendbc.get_generated_dbcs().items():
        (folder / f"{name}.dbc").write_text(text)

    def path(name: str) -> Path:
        whole = Path(opendbc.__file__).parent / "dbc" / f"{name}.dbc"
        return whole if whole.exists() else folder / whole.name

    return path
