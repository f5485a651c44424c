"""Logs for the journal and for people, and repeats that are held back."""

from __future__ import annotations

import logging
import os
import socket
import subprocess
import sys
import threading
from logging.handlers import SysLogHandler

import pytest
from tests.support.waiting import PATIENCE

from echogrid.watching.journal import RepeatFilter

TALK = """
import logging
from echogrid.watching import journal
journal.configure("info")
log = logging.getLogger("echogrid.can.talk")
log.debug("unheard")
log.info("live on %s", "can0")
log.warning("slow")
try:
    1 / 0
except ZeroDivisionError:
    log.exception("broken")
"""


def stderr_of(*command: str, journal: bool) -> list[str]:
    """What a program writes to a stderr that is, or is not, the journal's socket."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        there = os.fstat(theirs.fileno())
        # Where it is not, the variable is there all the same, as for a program whose service redirects it.
        stream = f"{there.st_dev}:{there.st_ino + (not journal)}"
        environment = {**os.environ, "JOURNAL_STREAM": stream}
        subprocess.run([sys.executable, *command], stderr=theirs, env=environment, timeout=PATIENCE, check=False)
        theirs.close()
        with ours.makefile() as lines:
            return lines.read().splitlines()


def test_the_journal_gets_levels_and_nothing_that_it_has_itself() -> None:
    lines = stderr_of("-c", TALK, journal=True)
    assert lines[0] == f"<{SysLogHandler.LOG_INFO}>echogrid.can.talk: live on can0"
    assert lines[1] == f"<{SysLogHandler.LOG_WARNING}>echogrid.can.talk: slow"
    assert lines[2] == f"<{SysLogHandler.LOG_ERR}>echogrid.can.talk: broken"
    assert len(lines) > 5
    assert all(line.startswith(f"<{SysLogHandler.LOG_ERR}>") for line in lines[2:])  # the traceback too
    assert lines[-1].endswith("ZeroDivisionError: division by zero")


def test_a_person_gets_levels_in_words() -> None:
    lines = stderr_of("-c", TALK, journal=False)
    assert lines[:3] == ["INFO echogrid.can.talk: live on can0", "WARNING echogrid.can.talk: slow", "ERROR echogrid.can.talk: broken"]


@pytest.mark.parametrize("journal", [True, False])
def test_the_last_words_are_an_error_in_the_journal(journal: bool) -> None:
    lines = stderr_of("-m", "echogrid", "check", "-c", "none.toml", journal=journal)
    assert lines == [("<3>" if journal else "") + "echogrid: none.toml: cannot be read: No such file or directory"]


def test_the_log_level_is_obeyed() -> None:
    code = TALK.replace("info", "error", 1)
    assert stderr_of("-c", code, journal=False)[0] == "ERROR echogrid.can.talk: broken"


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def logged(filter_: RepeatFilter, template: str, *args: object, name: str = "echogrid", level: int = logging.WARNING) -> str | None:
    """The message as it comes out, None where it is held back."""
    record = logging.LogRecord(name, level, "", 0, template, args, None)
    return record.getMessage() if filter_.filter(record) else None


def test_repeats_come_once_a_minute_with_their_number() -> None:
    clock = Clock()
    limit = RepeatFilter(60.0, clock)
    shown = {}
    for second in range(200):
        clock.now = 1000.0 + second
        text = logged(limit, "radar %s: lost %d", "fl", second)
        if text is not None:
            shown[second] = text
    assert shown == {
        0: "radar fl: lost 0",
        60: "radar fl: lost 60 (repeated 59 times)",
        120: "radar fl: lost 120 (repeated 59 times)",
        180: "radar fl: lost 180 (repeated 59 times)",
    }


def test_what_comes_seldom_is_never_held_back_nor_counted() -> None:
    clock = Clock()
    limit = RepeatFilter(60.0, clock)
    for _ in range(5):
        assert logged(limit, "100 % lost") == "100 % lost"
        clock.now += 60.0


def test_another_template_logger_or_level_is_another_message() -> None:
    limit = RepeatFilter(60.0, Clock())
    assert logged(limit, "a") == logged(limit, "a", name="other") == logged(limit, "a", level=logging.ERROR) == "a"
    assert logged(limit, "b") == "b"
    assert logged(limit, "a") is logged(limit, "b") is None


def test_what_is_said_of_one_bus_holds_back_nothing_of_another() -> None:
    """Else one bus is lost and the other is back, as far as the journal knows."""
    limit = RepeatFilter(60.0, Clock())
    assert logged(limit, "bus '%s': lost: %s", "front", "a") == "bus 'front': lost: a"
    assert logged(limit, "bus '%s': lost: %s", "rear", "a") == "bus 'rear': lost: a"
    assert logged(limit, "bus '%s': lost: %s", "front", "b") is None
    assert logged(limit, "%s", "map.egmap: the disk is full") == "map.egmap: the disk is full"
    assert logged(limit, "%s", "map.learned.json: cannot be written") == "map.learned.json: cannot be written"
    assert logged(limit, "%s", "map.egmap: the disk is full") is None


def test_messages_that_are_all_different_do_not_fill_the_memory() -> None:
    limit = RepeatFilter(60.0, Clock())
    for n in range(10_000):
        assert logged(limit, f"frame {n}") == f"frame {n}"
    assert logged(limit, "frame 9999") is None  # the newest are remembered, the oldest not
    assert logged(limit, "frame 0") == "frame 0"


def test_many_threads_may_say_different_things_at_once() -> None:
    """Logging holds no lock while it asks a filter; without one of its own this fails now and then."""
    limit, failed, usual = RepeatFilter(60.0, Clock()), list[Exception](), sys.getswitchinterval()

    def talk(name: int) -> None:
        try:
            for number in range(5000):
                logged(limit, f"{name} says {number}")
        except Exception as error:
            failed.append(error)

    sys.setswitchinterval(1e-6)
    try:
        threads = [threading.Thread(target=talk, args=(name,)) for name in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(usual)
    assert failed == []
