"""Real CAN interfaces without hardware, and the demo drive on them at the pace of a car's buses."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import can

from echogrid.logs.log import Log
from tests.support.places import DEMO

VEHICLE = "test-16-organic"  # the demo drive's
CHASSIS, RADARS = "rigcan0", "rigcan1"  # classic CAN and CAN FD
CLASSIC_MTU, FD_MTU = 16, 72
MOTION_IDS = range(0x100, 0x110)  # of the demo drive; all others are the radars'
BUFFER_KIB = 1024  # of each bus: 2,730 CAN FD frames, all of a test's drive; the service waits for its processor longer than a car's may
EARLY = 0.001  # s: not worth sleeping for
SO_RCVBUFFORCE = 33  # socket(7): beyond net.core.rmem_max, for root


class NoInterfacesError(Exception):
    """Why this machine's own kernel has no such interfaces for us."""


@contextmanager
def interfaces() -> Iterator[None]:
    """CHASSIS and RADARS, up; gone afterwards. Raises NoInterfacesError."""
    if os.geteuid() != 0:
        raise NoInterfacesError("only root may make vcan interfaces")
    try:
        for name, mtu in ((CHASSIS, CLASSIC_MTU), (RADARS, FD_MTU)):
            _ip("link", "add", "dev", name, "type", "vcan")
            _ip("link", "set", "dev", name, "mtu", str(mtu), "up")
        yield
    finally:
        for name in (CHASSIS, RADARS):
            subprocess.run(["ip", "link", "delete", "dev", name], capture_output=True, check=False)


def up(name: str, yes: bool) -> None:
    """Takes an interface up or down."""
    _ip("link", "set", "dev", name, "up" if yes else "down")


def _ip(*arguments: str) -> None:
    try:
        subprocess.run(["ip", *arguments], capture_output=True, text=True, check=True)
    except FileNotFoundError as error:
        raise NoInterfacesError("there is no ip, which the package iproute2 brings") from error
    except subprocess.CalledProcessError as error:
        raise NoInterfacesError(f"ip {' '.join(arguments)}: {error.stderr.strip()}") from error


def configuration(port: int, model: str = "analytic") -> str:
    """The demo drive's, with motion and radars on buses of their own and Zenoh on a port of the loopback."""
    text = (DEMO / "echogrid.toml").read_text()
    top, rest = text.split("[[bus]]")
    cars = rest[rest.index("[motion]") :].replace('bus = "can0"', 'bus = "chassis"', 1).replace('bus = "can0"', 'bus = "radars"')
    return (
        f'{top}model = "{model}"\n'
        f'[[bus]]\nname = "chassis"\nchannel = "{CHASSIS}"\nfd = false\nreceive_buffer_kib = {BUFFER_KIB}\n'
        f'[[bus]]\nname = "radars"\nchannel = "{RADARS}"\nreceive_buffer_kib = {BUFFER_KIB}\n'
        f'{cars}\n[publish]\nlisten = ["tcp/127.0.0.1:{port}"]\n'
    )


def drive(seconds: float, everything_on: str | None = None) -> list[can.Message]:
    """The first seconds of the demo drive, each message with the interface that it is to go on as its channel.

    Radars end a quarter of a second before the motion: all their scans are then mapped without the drive's being ended by hand.
    """
    messages: list[can.Message] = []
    for message in Log(DEMO / "can.log.gz"):
        motion = message.arbitration_id in MOTION_IDS
        since = message.timestamp - messages[0].timestamp if messages else 0.0
        if since > seconds:
            return messages
        if motion or since < seconds - 0.25:
            message.channel = everything_on or (CHASSIS if motion else RADARS)
            message.is_rx = False
            messages.append(message)
    raise ValueError(f"the demo drive has not {seconds} s")


def play(messages: Sequence[can.Message], buses: dict[str, can.BusABC]) -> None:
    """Sends each message when it is due."""
    ahead = time.monotonic() - messages[0].timestamp
    for message in messages:
        wait = message.timestamp + ahead - time.monotonic()
        if wait > EARLY:
            time.sleep(wait)
        buses[str(message.channel)].send(message)


@contextmanager
def senders() -> Iterator[dict[str, can.BusABC]]:
    """A bus for each interface, which receives nothing."""
    buses = {
        name: can.Bus(interface="socketcan", channel=name, fd=name == RADARS, can_filters=[], ignore_config=True)
        for name in (CHASSIS, RADARS)
    }
    try:
        yield buses
    finally:
        for bus in buses.values():
            bus.shutdown()


@contextmanager
def capture() -> Iterator[can.BusABC]:
    """Everything on every interface, in the order of the kernel and with its stamps, kept by the kernel until it is read."""
    with can.Bus(interface="socketcan", channel="", fd=True, ignore_config=True) as bus:
        bus.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, 64 << 20)
        yield bus
