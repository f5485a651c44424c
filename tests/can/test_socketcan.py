"""Many frames out of one socket at once: the same that python-can makes of each. Real interfaces: tests/rig."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Iterator

import can
import pytest
from can.interfaces.socketcan.socketcan import build_can_frame
from hypothesis import given
from hypothesis import strategies as st
from tests.support.waiting import PATIENCE

from echogrid.can.intake.socketcan import Inbox

SO_TIMESTAMPNS = 35  # asm-generic/socket.h
Pair = tuple[socket.socket, socket.socket]


@pytest.fixture(scope="module")
def pair() -> Iterator[Pair]:
    """Packets as a CAN socket gives them, but for the kernel's times."""
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with one, other:
        yield one, other


@st.composite
def messages(draw: st.DrawFn) -> can.Message:
    fd, extended = draw(st.booleans()), draw(st.booleans())
    remote = not fd and draw(st.booleans())
    length = draw(st.sampled_from([0, 1, 8, 12, 64] if fd else [0, 1, 7, 8]))
    return can.Message(
        arbitration_id=draw(st.integers(0, (1 << 29) - 1 if extended else 0x7FF)),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        bitrate_switch=fd and draw(st.booleans()),
        error_state_indicator=fd and draw(st.booleans()),
        dlc=length,
        data=None if remote else draw(st.binary(min_size=length, max_size=length)),
        channel="can3",
    )


@given(st.lists(messages(), min_size=1, max_size=20))
def test_frames_are_those_that_were_sent(pair: Pair, sent: list[can.Message]) -> None:
    sender, receiver = pair
    before = time.time()
    for message in sent:
        sender.send(build_can_frame(message))
    inbox = Inbox(receiver, 100)
    assert not inbox.reads
    batch = inbox.take("can3")
    assert batch is not None
    names = ("arbitration_id", "is_extended_id", "is_remote_frame", "is_error_frame", "is_fd", "is_rx", "bitrate_switch", "dlc", "channel")
    for message, found in zip(sent, batch, strict=True):
        assert [getattr(found, name) for name in names] == [getattr(message, name) for name in names]
        assert found.error_state_indicator == message.error_state_indicator
        assert found.data == bytes(message.data)
        assert before <= found.timestamp <= time.time()
    assert inbox.take("can3") is None
    assert inbox.reads


def test_times_are_the_kernels() -> None:
    """UDP sockets give them as CAN sockets do."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        receiver.bind(("127.0.0.1", 0))
        receiver.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        for _ in range(20):  # the kernel begins to stamp a moment after it is asked to, a longer one where it is busy
            before = time.time()
            sender.sendto(build_can_frame(can.Message(arbitration_id=1)), receiver.getsockname())
            assert select.select([receiver], [], [], PATIENCE)[0]  # it has come
            time.sleep(0.05)
            read = time.time()
            batch = Inbox(receiver, 100).take(None)
            assert batch is not None
            assert before - 0.001 <= batch.stamps[0]
            if batch.stamps[0] < read:
                return
    pytest.fail("no stamp is older than the reading")


def test_an_error_frame_is_one_and_what_is_no_frame_is_left_out(pair: Pair) -> None:
    sender, receiver = pair
    sender.send((0x20000040).to_bytes(4, "little") + bytes((8, 0, 0, 0)) + bytes(8))
    sender.send(b"no frame")
    batch = Inbox(receiver, 100).take(None)
    assert batch is not None
    (found,) = batch
    assert (found.is_error_frame, found.arbitration_id, found.channel) == (True, 0x40, None)


def test_no_more_are_taken_than_asked_for_and_the_rest_waits(pair: Pair) -> None:
    sender, receiver = pair
    for number in range(5):
        sender.send(build_can_frame(can.Message(arbitration_id=number, is_extended_id=False)))
    inbox = Inbox(receiver, 3)
    first, second = (inbox.take(1) for _ in range(2))
    assert first is not None
    assert second is not None
    assert [*first.ids.tolist(), *second.ids.tolist()] == [0, 1, 2, 3, 4]
