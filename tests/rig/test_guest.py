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
        if (lack := guest.missing()) is not None:
            pytest.skip(f"{why}, and {lack}; tests/live/test_service.py covers this on virtual buses")
    in_guest(HERE / "test_can.py")


@pytest.mark.skipif(os.environ.get("RIG") != "full", reason="'make test-rig' runs this: it needs minutes, and the Debian package")
def test_under_systemd() -> None:
    if (lack := guest.missing()) is not None:
        pytest.skip(f"{lack}; 'make test-rig RIG=here' runs this on a machine that may be changed")
    in_guest(HERE / "test_systemd.py", systemd=True)


@pytest.mark.parametrize(
    ("flags", "compiler", "boots"), [("fpu avx512_vnni", False, True), ("fpu amx_tile", True, True), ("fpu amx_tile", False, False)]
)
def test_no_guest_where_its_kernel_would_panic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flags: str, compiler: bool, boots: bool
) -> None:
    monkeypatch.setattr("shutil.which", lambda name: f"/usr/bin/{name}" if compiler or name != "cc" else None)
    (tmp_path / "cpuinfo").write_text(f"processor\t: 0\nflags\t\t: {flags} amx_bf16\n")
    lack = guest.missing(tmp_path / "cpuinfo")
    assert lack is None if boots else "there is no C compiler" in str(lack)


def in_guest(tests: Path, *, systemd: bool = False) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--color=no", "--exitfirst", "--log-cli-level=INFO", str(tests)]
    answer = guest.run(["env", "RIG=guest", *command], systemd=systemd, timeout=900)
    sys.stdout.write(answer.output)  # `make test-rig` shows it
    assert answer.status == 0, answer.output
