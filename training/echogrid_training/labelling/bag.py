"""Messages of one type out of an MCAP file or a bag of ROS 2 that holds some."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from echogrid.errors import EchogridError
from echogrid_training.sources import some

Decoded = TypeVar("Decoded")


def files(source: Path) -> list[Path]:
    """The MCAP files of a source, none of a folder that is no bag of them. Raises EchogridError for a bag in SQLite."""
    if source.is_file():
        return [source] if source.suffix == ".mcap" else []
    bags = sorted(source.glob("*.mcap"))
    if not bags and any(source.glob("*.db3")):
        raise EchogridError(f"{source}: is a bag in SQLite; make an MCAP of it with: ros2 bag convert")
    return bags


def messages(paths: list[Path], kind: str, topic: str | None, option: str, decode: Callable[[bytes], Decoded]) -> Iterator[Decoded]:
    """In the files' order. `kind`: the type; `topic` where there are several of it, given by `option`. Raises EchogridError."""
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
    except ImportError as error:
        raise EchogridError(f"{paths[0]}: mcap is not installed: pip install mcap") from error

    for path in paths:
        with path.open("rb") as file:
            try:
                reader = make_reader(file)
                wanted = _topic(path, reader.get_summary(), kind, topic, option)
                for _, channel, message in reader.iter_messages(topics=[wanted]):
                    if channel.message_encoding != "cdr":
                        raise ValueError(f"its {kind} are encoded as {channel.message_encoding}, expected cdr")
                    yield decode(message.data)
            except (McapError, ValueError, KeyError, EOFError, struct.error, zlib.error) as error:
                raise EchogridError(f"{path}: cannot be read as a recording of {kind}: {error}") from error


def _topic(path: Path, summary: object, kind: str, topic: str | None, option: str) -> str:
    channels = [] if summary is None else list(summary.channels.values())  # type: ignore[attr-defined]
    schemas = {} if summary is None else summary.schemas  # type: ignore[attr-defined]
    kinds = {one.topic: schemas[one.schema_id].name if one.schema_id in schemas else "no type" for one in channels}
    fitting = sorted(name for name, its in kinds.items() if its == kind)
    if topic is not None and topic not in fitting:
        raise EchogridError(f"{path}: has no topic {topic} of type {kind}, found {some(fitting)}")
    if topic is None and len(fitting) != 1:
        known = some(f"{name} ({its})" for name, its in sorted(kinds.items()))
        hint = f"give one with {option}" if fitting else "expected one"
        raise EchogridError(f"{path}: has {len(fitting)} topics of type {kind}: {hint}; its topics are {known}")
    return topic or fitting[0]
