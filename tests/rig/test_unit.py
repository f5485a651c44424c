"""The unit as systemd's own tools judge it, without a systemd that runs."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support.places import DEPLOY

UNIT = DEPLOY / "echogrid.service"

pytestmark = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="there is no systemd-analyze; 'make test-rig' installs systemd"
)


@pytest.mark.parametrize("judgement", [("verify", "--man=no", "--recursive-errors=yes"), ("security", "--offline=yes", "--threshold=15")])
def test_the_unit_is_sound_and_its_exposure_at_most_1_5(judgement: tuple[str, ...], tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/usr/bin/echogrid", "/bin/true"))  # which need not be installed here
    done = subprocess.run(["systemd-analyze", *judgement, str(unit)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
