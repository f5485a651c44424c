"""What an MCAP file holds by mcap's own reader, decoded by rosbags with nothing but the file's own definitions."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


@dataclass(frozen=True)
class Read:
    topic: str
    type: str
    log_time: int
    publish_time: int
    sequence: int
    data: bytes
    message: Any


def decoder() -> Any:
    """A function of a type's name, its definition and CDR."""
    stores: dict[str, Any] = {}

    def decode(name: str, definition: str, data: bytes) -> Any:
        if name not in stores:
            stores[name] = get_typestore(Stores.EMPTY)
            stores[name].register(get_types_from_msg(definition, name))
        message = stores[name].deserialize_cdr(data, name)
        assert bytes(stores[name].serialize_cdr(message, name)) == data
        return message

    return decode


def read(path: Path) -> list[Read]:
    """All messages in the file's order, each in CDR, which goes back to the same bytes; a string is JSON."""
    decode, messages = decoder(), []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            assert schema is not None
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
            content = decode(schema.name, schema.data.decode(), message.data)
            if schema.name == "std_msgs/msg/String":
                content = json.loads(content.data)
            row = (channel.topic, schema.name, message.log_time, message.publish_time, message.sequence, message.data, content)
            messages.append(Read(*row))
    return messages
