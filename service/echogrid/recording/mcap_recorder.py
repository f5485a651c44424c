"""The recording of a running service: a bounded queue that nothing waits for, and the thread that empties it into an MCAP file."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import can

from echogrid.recording.mcap_writer import McapWriter
from echogrid.threads import WAIT
from echogrid.topics.topic import Message, Topic

log = logging.getLogger("echogrid")
MOST_WAITING = 32 << 20  # bytes; as many again while they are written
FRAME_BYTES = 1 << 10  # that a frame takes while it waits
FLUSH_PERIOD = 1.0  # s: no more is lost where the process is killed
STATES = ("recording", "failed", "closed")

Item = Message | tuple[str, can.Message]


@dataclass(slots=True)
class Recording:
    """How a recording is doing; part of the status."""

    file: str
    state: str = STATES[0]
    reason: str = ""  # for a failure
    messages: int = 0  # in the file, of those that were published
    frames: int = 0  # in the file, from the buses
    left_out: int = 0  # for which there was no room in the queue, or which are not frames: a replay may give another map
    mib: float = 0.0  # of the file


class McapRecorder:
    """Any thread puts, one thread runs `run`. A full disk ends the recording, not the service."""

    def __init__(self, path: Path) -> None:
        """Raises EchogridError where the file cannot be made."""
        self.recording = Recording(str(path))
        self._writer = McapWriter(path)
        self._lock = threading.Lock()
        self._waiting: list[Item] = []
        self._bytes = 0
        self._flush_at = time.monotonic()  # the file's head at once: who is killed soon leaves an empty recording, and no file that is none

    def wants(self, *topics: Topic) -> bool:
        """All."""
        return True

    def put(self, message: Message) -> None:
        """A message that is published. Such may fill half the queue, so that frames find room for longer."""
        self._put(message, len(message.payload), MOST_WAITING // 2)

    def frame(self, bus: str, message: can.Message) -> None:
        """A frame that is mapped next."""
        self._put((bus, message), FRAME_BYTES, MOST_WAITING)

    def run(self, stop: threading.Event) -> None:
        """Writes what was put, until `stop`."""
        while not stop.wait(WAIT):
            self._write()

    def close(self) -> None:
        """Writes what is left, and the file's end."""
        self._write()
        if self.recording.state == "recording":
            try:
                self._writer.close()
                self.recording.state = "closed"
            except Exception as error:  # mostly a full disk, as in _write
                self._fail(error)

    def _put(self, item: Item, size: int, limit: int) -> None:
        if self.recording.state != "recording":
            return
        with self._lock:
            if self._bytes + size > limit:
                self.recording.left_out += 1
                return
            self._waiting.append(item)
            self._bytes += size

    def _write(self) -> None:
        with self._lock:
            items, self._waiting, self._bytes = self._waiting, [], 0
        if self.recording.state != "recording":
            return
        try:
            for item in items:
                self._write_one(item)
            if time.monotonic() >= self._flush_at:
                self._flush_at = time.monotonic() + FLUSH_PERIOD
                self._writer.flush()
            self.recording.mib = self._writer.size / (1 << 20)
        except Exception as error:  # mostly OSError; whatever it is, the map matters more
            self._fail(error)

    def _write_one(self, item: Item) -> None:
        recording = self.recording
        if isinstance(item, Message):
            self._writer.put(item)
            recording.messages += 1
            return
        try:
            self._writer.frame(*item)
            recording.frames += 1
        except ValueError:  # of a frame that no bus can carry
            with self._lock:
                recording.left_out += 1

    def _fail(self, error: Exception) -> None:
        self.recording.state, self.recording.reason = "failed", getattr(error, "strerror", None) or str(error)
        self._writer.abandon()
        log.error("%s: the recording ends here: %s; mapping continues", self.recording.file, self.recording.reason)
