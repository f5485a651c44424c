"""A bus that goes away and comes back. That real SocketCAN interfaces do so is shown by tests/rig."""

from __future__ import annotations

import errno
import socket
import threading
import time
from collections.abc import Iterator
from functools import partial
from queue import Empty, SimpleQueue

import can
import pytest
from can.interfaces.slcan import slcanBus
from can.interfaces.socketcan import socketcan
from tests.support.frames import frame
from tests.support.waiting import PATIENCE, until

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


class Stuck(can.BusABC):
    """A driver that fails once, and then does not come back from reading until it is let go."""

    def __init__(self) -> None:
        self.fails, self.came_back = True, False
        self.reads, self.let_go = threading.Event(), threading.Event()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.fails:
            self.fails = False
            raise can.CanOperationError("Error receiving: no such device", 19)
        self.reads.set()
        self.let_go.wait(PATIENCE)
        self.came_back = True
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise NotImplementedError

    def shutdown(self) -> None:
        raise OSError(errno.EIO, "the device is gone")


def test_who_maps_does_not_wait_for_the_driver_of_a_bus_that_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its thread is waited for by who closes the bus, at the latest at the end, which no driver that fails then disturbs."""
    stuck = Stuck()
    monkeypatch.setattr(live, "open_bus", lambda bus, ids: stuck)
    monkeypatch.setattr(live.log, "warning", lambda *_: stuck.reads.wait(PATIENCE))  # as long as a journal may take
    bus = LiveBus(BUS, [ID])
    until(lambda: not bus.is_open, lambda: taken(bus))
    assert stuck.reads.is_set()
    assert not stuck.came_back
    assert not bus.refresh().up
    stuck.let_go.set()
    bus.close()
    assert stuck.came_back
    assert not [thread for thread in threading.enumerate() if thread.name == "watch"]


@pytest.mark.parametrize("where", ["reading", "closing"])
def test_a_driver_that_never_comes_back_is_left_behind(
    where: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """In a thread that no end of the program waits for, and that is said."""
    stuck = Stuck()
    stuck.fails = False
    if where == "closing":
        monkeypatch.setattr(stuck, "shutdown", partial(stuck.recv, None))
        monkeypatch.setattr(stuck, "recv", lambda timeout=None: time.sleep(0.001))
    monkeypatch.setattr(live, "open_bus", lambda bus, ids: stuck)
    monkeypatch.setattr(live, "PATIENCE", 0.1)
    bus = LiveBus(BUS, [ID])
    assert where == "closing" or stuck.reads.wait(PATIENCE)
    bus.close()
    bus.close()
    assert not stuck.came_back
    said = "bus 'radars': the driver of virtual channel 'test_bus' does not come back: it is not closed in good order"
    assert caplog.messages == [said]
    left = [thread for thread in threading.enumerate() if thread.name in ("watch", "end")]
    assert left
    assert all(thread.daemon for thread in left)
    stuck.let_go.set()
    for thread in left:
        thread.join(PATIENCE)
    assert stuck.came_back


class Adapter(slcanBus):
    """python-can's reading of the lines of a serial adapter, without the port."""

    def __init__(self) -> None:
        self.lines: SimpleQueue[str] = SimpleQueue()
        self._queue = SimpleQueue()
        can.BusABC.__init__(self, "adapter")

    def _read(self, timeout: float | None) -> str | None:
        try:
            return self.lines.get(timeout=timeout)
        except Empty:
            return None

    def shutdown(self) -> None:
        can.BusABC.shutdown(self)


@pytest.mark.parametrize("line", ["t1232A1B2", "T0000012331A2B3C", "d1239112233445566778899AABBCC", "B000001232A1B2", "r1232"])
def test_of_a_line_of_a_serial_adapter_that_is_torn_anywhere_no_frame_comes(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each piece of it is an error that is counted; the whole line behind them is a frame."""
    adapter = Adapter()
    monkeypatch.setattr(live, "open_bus", lambda bus, ids: adapter)
    bus = LiveBus(BUS, [])
    for end in range(1, len(line)):
        adapter.lines.put(f"{line[:end]}\r")
    adapter.lines.put(f"{line}\r")
    batch = until(lambda: taken(bus))
    (found,) = batch
    assert (found.arbitration_id, found.data.hex().upper()) == (0x123, line[-2 * len(found.data) :] if found.data else "")
    assert len(found.data) == (0 if found.is_remote_frame else found.dlc)
    assert (bus.refresh().errors, bus.health.frames) == (len(line) - 1, 1)
    bus.close()


@pytest.mark.parametrize("line", ["tFFF1A1", "t-121A1", "TFFFFFFFF1A1"])
def test_an_id_that_no_frame_has_spoils_itself_alone(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    adapter = Adapter()
    monkeypatch.setattr(live, "open_bus", lambda bus, ids: adapter)
    bus = LiveBus(BUS, [])
    for one in ("t1231A1", line, "t1241A1"):
        adapter.lines.put(f"{one}\r")
    ids = list[int]()
    until(lambda: len(ids) == 2, lambda: ids.extend(() if (batch := taken(bus)) is None else batch.ids.tolist()))
    assert (ids, bus.refresh().errors) == ([0x123, 0x124], 1)
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

    def is_back() -> bool:
        bus.bring_back()
        taken(bus)
        return bus.health.reconnects == 1

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
    until(is_back)
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


def test_the_socket_of_a_bus_that_cannot_be_opened_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """At once, though whoever caught the error still holds it; python-can makes it, and then finds no such interface."""
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with made:

        def nowhere(*_: object) -> None:
            raise OSError(errno.ENODEV, "No such device")

        monkeypatch.setattr(socketcan, "create_socket", lambda: made)
        monkeypatch.setattr(socketcan, "bind_socket", nowhere)
        with pytest.raises(EchogridError, match="there is no such network interface") as caught:
            LiveBus(Bus(name="radars", channel="nowhere97"), [ID])
        assert caught.value.__cause__ is not None
        assert made.fileno() == -1
