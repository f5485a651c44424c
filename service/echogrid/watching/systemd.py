"""What systemd is told, by its protocol sd_notify(3): one datagram to the socket that NOTIFY_SOCKET names. Nothing without one."""

from __future__ import annotations

import os
import socket
import time
from contextlib import suppress


class Notifier:
    """Tells the service manager how the service is doing. `active` is False if there is none."""

    def __init__(self) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "")
        self.active = bool(address)
        self._address = "\0" + address[1:] if address.startswith("@") else address  # @: an abstract name

    def ready(self, status: str) -> None:
        self._send(f"READY=1\nSTATUS={status}")

    def status(self, status: str) -> None:
        """One line for `systemctl status`."""
        self._send(f"STATUS={status}")

    def alive(self) -> None:
        """Feeds the watchdog."""
        self._send("WATCHDOG=1")

    def reloading(self) -> None:
        """To be followed by `ready`."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000}")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self.active:
            return
        # A manager that does not listen now must not stop a service that works; its watchdog will tell.
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.sendto(text.encode(), socket.MSG_DONTWAIT, self._address)
