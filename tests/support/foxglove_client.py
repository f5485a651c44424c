"""A viewer as Foxglove's is, by its protocol alone: advertised channels, subscriptions, messages."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from tests.support.waiting import PATIENCE
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

MESSAGE = struct.Struct("<BIQ")  # opcode, subscription, log time; behind them the payload


class Viewer:
    """Remembers the server's greeting and its channels by their topics."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.server = json.loads(connection.recv(PATIENCE))
        advertised = json.loads(connection.recv(PATIENCE))
        assert (self.server["op"], advertised["op"]) == ("serverInfo", "advertise")
        self.channels: dict[str, dict[str, Any]] = {channel["topic"]: channel for channel in advertised["channels"]}

    def subscribe(self, topics: Sequence[str]) -> None:
        """The place of a topic in `topics` is its subscription's number."""
        subscriptions = [{"id": n, "channelId": self.channels[topic]["id"]} for n, topic in enumerate(topics)]
        self.connection.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def receive(self, timeout: float) -> tuple[int, int, bytes] | None:
        """Subscription, log time and payload of the next message; None after `timeout` seconds."""
        try:
            data = self.connection.recv(timeout)
        except TimeoutError:
            return None
        assert isinstance(data, bytes)
        opcode, subscription, log_time = MESSAGE.unpack_from(data)
        assert opcode == 1
        return subscription, log_time, data[MESSAGE.size :]


@contextmanager
def viewer(port: int) -> Iterator[Viewer]:
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as connection:
        yield Viewer(connection)
