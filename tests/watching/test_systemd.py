"""What systemd hears, on a socket of the kind that it gives."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from tests.support.waiting import PATIENCE

from echogrid.watching.systemd import Notifier


@pytest.mark.parametrize("abstract", [False, True])
def test_each_call_is_one_datagram(abstract: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = f"@echogrid-{tmp_path.name}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("\0" + name[1:] if abstract else name)
        manager.settimeout(PATIENCE)
        monkeypatch.setenv("NOTIFY_SOCKET", name)
        notifier = Notifier()
        assert notifier.active
        notifier.ready("live on can0")
        notifier.alive()
        notifier.reloading()
        notifier.stopping()
        heard = [manager.recv(4096).decode() for _ in range(4)]
    assert heard[:2] == ["READY=1\nSTATUS=live on can0", "WATCHDOG=1"]
    assert heard[2].startswith("RELOADING=1\nMONOTONIC_USEC=")
    assert heard[3] == "STOPPING=1"


def test_without_a_manager_nothing_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    notifier = Notifier()
    assert not notifier.active
    notifier.alive()


def test_a_manager_that_is_gone_stops_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "nobody"))
    Notifier().alive()
