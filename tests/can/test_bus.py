"""A bus that goes away and comes back. That real SocketCAN interfaces do so is shown by tests/rig."""

from __future__ import annotations

import errno
from collections.abc import Iterator

import can
import pytest
from tests.support.frames import frame
from tests.support.waiting import until

from echogrid.can import bus as live
from echogrid.can.bus import LiveBus, wait
from echogrid.can.intake.frames import FrameBatch
from echogrid.config.tables import Bus
from echogrid.errors import EchogridError

BUS = Bus(name="radars", interface="virtual", channel="test_bus")
ID = (0x300, False)


class Unplugged(can.BusABC):
    """A virtual bus whose driver fails in the way that SocketCAN's does while `down`."""

    def __init__(self, opened: can.BusABC) -> None:
        self.opened = opened
        self.down = False

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.down:
            raise can.CanOperationError("Error receiving: Network is down", 100)
        return self.opened.recv(timeout)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise NotImplementedError  # BusABC demands the method; nobody sends here

    def shutdown(self) -> None:
        self.opened.shutdown()


def taken(bus: LiveBus) -> FrameBatch | None:
    """What a look finds that waits a moment."""
    wait([bus], 0.05)
    return bus.take()


@pytest.fixture
def sender() -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel="test_bus", protocol=can.CanProtocol.CAN_FD, preserve_timestamps=True) as bus:
        yield bus


def test_only_what_is_read_passes(sender: can.BusABC) -> None:
    bus = LiveBus(BUS, [ID])
    sender.send(frame(0x301, b"\x01", 1.0))
    sender.send(frame(0x300, b"\x02", 2.0))
    batch = until(lambda: taken(bus))
    assert (batch.ids.tolist(), batch.stamps.tolist()) == ([0x300], [2.0])
    assert bus.refresh().frames == 1
    bus.close()
    bus.close()


def test_error_frames_are_counted_and_bus_off_is_down_until_the_next_frame(sender: can.BusABC) -> None:
    bus = LiveBus(BUS, [])  # no filter: a controller's error frames come with ids of their own
    for number in (0x04, live.CAN_ERR_BUSOFF):
        sender.send(can.Message(arbitration_id=number, is_error_frame=True, is_extended_id=False, data=bytes(8)))
    until(lambda: bus.refresh().errors == 2, lambda: taken(bus))
    health = bus.refresh()
    assert (health.errors, health.bus_off, health.up) == (2, 1, False)
    sender.send(frame(0x300, b"\x02", 2.0))
    until(lambda: taken(bus))
    assert bus.refresh().up
    bus.close()


def test_a_lost_bus_is_opened_again_and_again_until_it_can_be_read(sender: can.BusABC, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Unplugged] = []
    answers = ["open", "away", "down", "open"]  # first opening, no such device, there but down, back

    def open_next(bus: Bus, ids: list[tuple[int, bool]]) -> can.BusABC:
        answer = answers.pop(0)
        if answer == "away":
            raise EchogridError("no such device")
        opened.append(Unplugged(real(bus, ids)))
        opened[-1].down = answer == "down"
        return opened[-1]

    real = live.open_bus
    monkeypatch.setattr(live, "open_bus", open_next)
    monkeypatch.setattr(live, "FIRST_PAUSE", 0.01)
    bus = LiveBus(BUS, [ID])
    opened[0].down = True
    until(lambda: not bus.refresh().up, lambda: taken(bus))
    assert not bus.is_open
    until(lambda: bus.refresh().up, lambda: [bus.bring_back(), taken(bus)])  # type: ignore[func-returns-value]
    assert (bus.health.reconnects, answers) == (1, [])
    sender.send(frame(0x300, b"\x02", 2.0))
    until(lambda: taken(bus))
    bus.close()


class Garbled(Unplugged):
    """Some lines that came over a serial port are no frames, as python-can's slcan says it."""

    def __init__(self, opened: can.BusABC) -> None:
        super().__init__(opened)
        self.garbled = 0

    def recv(self, timeout: float | None = None) -> can.Message | None:
        message = super().recv(timeout)
        if message is not None and self.garbled:
            self.garbled -= 1
            raise ValueError("invalid literal for int() with base 16: '1?'")
        return message


def test_what_is_no_frame_is_an_error_that_is_counted_and_not_the_end(
    sender: can.BusABC, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    opened: list[Garbled] = []

    def open_garbled(bus: Bus, ids: list[tuple[int, bool]]) -> can.BusABC:
        opened.append(Garbled(real(bus, ids)))
        return opened[-1]

    def look() -> FrameBatch | None:
        bus.bring_back()
        return taken(bus)

    real = live.open_bus
    monkeypatch.setattr(live, "open_bus", open_garbled)
    monkeypatch.setattr(live, "FIRST_PAUSE", 0.01)
    bus = LiveBus(BUS, [ID])
    opened[0].garbled = 3
    for n in range(6):
        sender.send(frame(0x300, b"\x02", float(n)))
    stamps = list[float]()
    until(lambda: len(stamps) == 3, lambda: stamps.extend(() if (batch := taken(bus)) is None else batch.stamps.tolist()))
    assert (stamps, bus.refresh().errors, bus.health.reconnects) == ([3.0, 4.0, 5.0], 3, 0)
    assert caplog.text.count("makes no frame of what it received") == 3  # of which the journal shows one
    opened[0].garbled = live.MOST_GARBLED
    for n in range(live.MOST_GARBLED):
        sender.send(frame(0x300, b"\x02", float(n)))
    until(lambda: bus.health.reconnects == 1, look)
    assert "was lost: invalid literal" in caplog.text
    assert len(opened) == 2
    bus.close()


@pytest.mark.parametrize(
    ("interface", "error", "said"),
    [
        ("socketcan", OSError(errno.EAFNOSUPPORT, "?"), "this kernel has no SocketCAN, or has not loaded it: modprobe can_raw"),
        ("socketcan", OSError(errno.EPROTONOSUPPORT, "?"), "this kernel has no SocketCAN, or has not loaded it: modprobe can_raw"),
        ("socketcan", OSError(errno.ENODEV, "?"), "there is no such network interface, found "),
        ("kvaser", NameError("name 'canOpen' is not defined"), "the driver's library is not there (name 'canOpen' is not defined)"),
        ("pcan", OSError("pcanbasic library not found."), "pcanbasic library not found."),
    ],
)
def test_a_bus_that_cannot_be_opened_says_what_is_missing(
    interface: str, error: Exception, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: object) -> can.BusABC:
        raise error

    monkeypatch.setattr(can, "Bus", fail)
    with pytest.raises(EchogridError) as caught:
        LiveBus(Bus(name="radars", interface=interface, channel="one7"), [ID])
    assert str(caught.value).startswith(f"bus 'radars': {interface} channel 'one7' cannot be opened: {said}")


def test_what_is_said_of_this_very_kernel_is_no_number_of_an_error() -> None:
    """Without SocketCAN here, or without that interface."""
    with pytest.raises(EchogridError, match="this kernel has no SocketCAN|there is no such network interface, found") as caught:
        LiveBus(Bus(name="radars", channel="nowhere97"), [ID])
    assert "Errno" not in str(caught.value)
