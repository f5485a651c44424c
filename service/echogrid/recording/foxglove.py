"""A live view for Foxglove: a WebSocket that hands on the very bytes that are published."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from echogrid.errors import EchogridError
from echogrid.recording.viewer_channel import viewer_channel
from echogrid.topics.topic import META, STATUS, TOPICS, Message, Topic

LOOPBACK, PORT = "127.0.0.1", 8765  # the port that Foxglove offers


class Foxglove:
    """A server, open from construction to the end of `with`. One thread puts and waits for no viewer; one that is too slow loses messages.

    Viewers may read all topics and write nothing. Raises EchogridError where the address cannot be had, or the extra is not installed.
    """

    def __init__(self, host: str, port: int, vehicle: str) -> None:
        try:
            import foxglove
        except ImportError as error:
            raise EchogridError("--foxglove: foxglove-sdk is not installed: pip install foxglove-sdk") from error
        self._context = context = foxglove.Context()  # closes its channels when it goes
        self._channels: dict[str, foxglove.Channel] = {}
        for topic in TOPICS:
            described = viewer_channel(topic)
            schema = foxglove.Schema(name=described.schema, encoding=described.schema_encoding, data=described.definition)
            channel = foxglove.Channel(described.topic, schema=schema, message_encoding=described.message_encoding, context=context)
            self._channels[topic.name] = channel
        self._meta: bytes | None = None
        try:
            self._server = foxglove.start_server(name=f"echogrid {vehicle}", host=host, port=port, context=context)
        except Exception as error:  # the SDK's own, with what the operating system says
            raise EchogridError(f"--foxglove: {host}:{port} cannot be listened on: {error}") from error
        self.port = self._server.port  # the one that was assigned for port 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._server.stop()

    def wants(self, *topics: Topic) -> bool:
        """All."""
        return True

    def put(self, message: Message) -> None:
        """To the subscribers of its topic."""
        at_ns = max(message.stamp_ns, 0)
        self._channels[message.topic.name].log(message.payload, log_time=at_ns)
        if message.topic is META:
            self._meta = message.payload
        elif message.topic is STATUS and self._meta is not None:
            self._channels[META.name].log(self._meta, log_time=at_ns)  # which comes once, and a viewer may come later
