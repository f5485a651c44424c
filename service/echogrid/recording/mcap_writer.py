"""An MCAP file of what was published, and of the CAN frames that it was made from."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import can

from echogrid import __version__
from echogrid.errors import EchogridError
from echogrid.files import whole
from echogrid.logs.log import BY_PATH, OURS, PACKED
from echogrid.recording.bag import BagTopic, information, quality, serialized
from echogrid.recording.viewer_channel import ViewerChannel, can_channel, recorded_channel
from echogrid.topics.can_frame import LONGEST_NAME, encode_frame, stamp_ns
from echogrid.topics.cdr import encode_string
from echogrid.topics.topic import FULL, Message

CHUNK_BYTES = 4 << 20  # before it is packed
FRAMES_DEPTH = 1000  # frames that a player of the recording keeps for a slow subscriber
MOST_BUSES = 1000  # of a log that calls them ever otherwise


class McapWriter:
    """A new file, open from construction to `close` or the end of `with`. One thread writes.

    Where the path does not end in .mcap it becomes a folder, a ROS 2 bag: in it the file, NAME_0.mcap, and at the end metadata.yaml.

    What `flush` has returned for outlives the process. Raises EchogridError naming the file where it exists already or cannot be made, and
    where the extra is not installed; OSError in the course of it, where the disk is full.
    """

    def __init__(self, path: Path) -> None:
        try:
            from mcap.writer import Writer
        except ImportError as error:
            raise EchogridError(f"{path}: mcap is not installed: pip install mcap") from error
        if path.suffix in (*OURS, *BY_PATH, *PACKED, ".bag"):
            raise EchogridError(f"{path}: is not written, expected a name that ends in .mcap, or that of a folder for a bag of ROS 2")
        self._folder = None if path.suffix == ".mcap" else path
        self.path = path if self._folder is None else path / f"{path.name}_0.mcap"
        try:
            if self._folder is not None:
                self._folder.mkdir()
            self._file = self.path.open("xb")
        except FileExistsError as error:
            raise EchogridError(f"{path}: exists already, and a recording never replaces a file: choose another name") from error
        except OSError as error:
            raise EchogridError(f"{path}: cannot be written: {error.strerror}") from error
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="ros2", library=f"echogrid {__version__}")
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, int] = {}  # a topic's channel
        self._buses: dict[tuple[str, str | int | None], int] = {}  # a bus's channel, and what python-can calls it
        self._counts: Counter[int] = Counter()  # messages in a channel
        self._names: dict[int, str] = {}  # the topic of a channel
        self._bag: dict[str, BagTopic] = {}
        self._span: tuple[int, int] | None = None  # ns, of the first and the last message

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self._file.tell()

    def put(self, message: Message) -> None:
        """Exactly the published bytes, JSON as a string of ROS. Nothing for whole windows, which key frames and updates hold as well."""
        topic = message.topic
        if topic is FULL:
            return
        if topic.name not in self._topics:
            self._topics[topic.name] = self._channel(recorded_channel(topic), {}, quality(topic.depth, topic.kept))
        payload = message.payload if topic.type is not None else encode_string(message.payload.decode())
        self._add(self._topics[topic.name], message.stamp_ns, payload)

    def frame(self, bus: str, message: can.Message) -> None:
        """A CAN frame of a bus, in the order of mapping. Raises ValueError if a log's message is not a frame."""
        payload = encode_frame(bus, message)
        called = message.channel if isinstance(message.channel, str | int | None) else str(message.channel)
        if (bus, called) not in self._buses:
            if len(self._buses) == MOST_BUSES or len(str(called)) > LONGEST_NAME:
                raise ValueError("not a CAN frame: too many channels, or too long a name")
            self._buses[bus, called] = self._channel(can_channel(bus), {"channel": json.dumps(called)}, quality(FRAMES_DEPTH, False))
        self._add(self._buses[bus, called], stamp_ns(message), payload)

    def flush(self) -> None:
        """Ends the chunk, so that all that was put can be read."""
        self._writer.flush()  # type: ignore[no-untyped-call]  # mcap says no types here

    def close(self) -> None:
        """Ends the file with its index and the bag's description. A second time does nothing."""
        if self._file.closed:
            return
        first, last = self._span or (0, 0)
        with self._file:
            self._writer.add_metadata("rosbag2", {"serialized_metadata": serialized(information(None, self._bag, first, last))})
            self._writer.finish()  # type: ignore[no-untyped-call]  # nor here
        if self._folder is not None:
            described = information(self.path.name, self._bag, first, last)
            with whole(self._folder / "metadata.yaml") as partial:
                partial.write_text(serialized({"rosbag2_bagfile_information": described}))

    def discard(self) -> None:
        """Takes all away again."""
        self.abandon()
        self.path.unlink()
        if self._folder is not None:
            self._folder.rmdir()

    def abandon(self) -> None:
        """Leaves a file as it is that cannot be written any further."""
        with suppress(OSError):
            self._file.close()

    def _channel(self, channel: ViewerChannel, metadata: dict[str, str], offered: str) -> int:
        if channel.schema not in self._schemas:
            self._schemas[channel.schema] = self._writer.register_schema(channel.schema, channel.schema_encoding, channel.definition)
        schema, told = self._schemas[channel.schema], {**metadata, "offered_qos_profiles": offered}
        number = self._writer.register_channel(channel.topic, channel.message_encoding, schema, told)
        self._names[number] = channel.topic
        self._bag.setdefault(channel.topic, BagTopic(channel.schema, offered))
        return number

    def _add(self, channel: int, at_ns: int, payload: bytes) -> None:
        self._counts[channel] += 1
        self._bag[self._names[channel]].messages += 1
        at_ns = max(at_ns, 0)  # MCAP knows no time before 1970; the message itself keeps its own
        first, last = self._span or (at_ns, at_ns)
        self._span = min(first, at_ns), max(last, at_ns)
        self._writer.add_message(channel, at_ns, payload, at_ns, self._counts[channel] & 0xFFFFFFFF)
