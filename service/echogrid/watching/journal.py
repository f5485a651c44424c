"""What the program logs, as a terminal or systemd's journal wants it: levels kept, and no flood of the same message."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

LEVELS = ("debug", "info", "warning", "error")
PERIOD = 60.0  # s between two lines of the same kind
KINDS = 256  # of messages that are remembered, the newest ones


def configure(level: str) -> None:
    """All loggers write to stderr from now on, what is below one of LEVELS is left out."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JournalFormatter() if to_journal() else logging.Formatter("%(levelname)s %(name)s: %(message)s"))
    handler.addFilter(RepeatFilter())
    logging.basicConfig(level=level.upper(), handlers=[handler])
    for name in ("can", "numexpr"):  # log every socket they make, and their threads
        logging.getLogger(name).setLevel(max(logging.WARNING, logging.getLevelName(level.upper())))


def to_journal() -> bool:
    """Whether stderr leads to systemd's journal, as sd-daemon has it: JOURNAL_STREAM holds device and inode of that socket."""
    try:
        stderr = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):  # closed, or replaced by something without a descriptor
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{stderr.st_dev}:{stderr.st_ino}"


def prefixed(text: str, level: int) -> str:
    """For the journal: each line with its level in syslog's numbers, sd-daemon(3)."""
    number = 3 if level >= logging.ERROR else 4 if level >= logging.WARNING else 6 if level >= logging.INFO else 7
    return "\n".join(f"<{number}>{line}" for line in text.splitlines())


class JournalFormatter(logging.Formatter):
    """Neither time nor level in words: the journal has both. A traceback stays in one level."""

    def __init__(self) -> None:
        super().__init__("%(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        return prefixed(super().format(record), record.levelno)


@dataclass(slots=True)
class _Kind:
    shown_at: float
    hidden: int = 0


class RepeatFilter(logging.Filter):
    """Of messages of one logger, level, template and first argument the first passes at once, later ones at most once in `period` seconds.

    The first argument says which bus, radar or file it is about. The next that passes says how many did not. `clock`: monotonic, in s.
    """

    def __init__(self, period: float = PERIOD, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.period = period
        self.clock = clock
        self._kinds: dict[tuple[str, int, str, str], _Kind] = {}
        self._lock = threading.RLock()  # a handler's own is not held yet; a signal's handler may log within

    def filter(self, record: logging.LogRecord) -> bool:
        with self._lock:
            return self._passes(record)

    def _passes(self, record: logging.LogRecord) -> bool:
        about = str(record.args[0]) if isinstance(record.args, tuple) and record.args else ""
        key, now = (record.name, record.levelno, str(record.msg), about), self.clock()
        kind = self._kinds.get(key)
        if kind is not None and now - kind.shown_at < self.period:
            kind.hidden += 1
            return False
        if kind is not None and kind.hidden:
            record.msg = f"{record.msg} (repeated {kind.hidden} times)"
        self._kinds.pop(key, None)
        self._kinds[key] = _Kind(now)  # after all others: the first is the one that was shown longest ago
        if len(self._kinds) > KINDS:
            del self._kinds[next(iter(self._kinds))]
        return True
