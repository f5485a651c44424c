"""Formats that are not ours to read: SQLite and MF4, through python-can."""

from __future__ import annotations

import gc
import importlib
import logging
import re
import sqlite3
import sys
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import can
from can.io import mf4

from echogrid.can.intake.frames import FrameBatch, batches
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.times import END_OF_TIME, TOO_LATE

MF4 = (b"MDF ", b"UnFinMF ")  # how a file begins that was closed, or was not


def read_sqlite(path: Path, account: Account) -> Iterator[FrameBatch]:
    """The frames of python-can's table `messages`; it knows no channels. Raises ValueError and sqlite3's errors."""
    _check_database(path)
    reader = can.SqliteReader(path)
    try:
        yield from batches(checked(iter(reader), account))
    finally:
        reader.stop()


def read_mf4(path: Path, account: Account) -> Iterator[FrameBatch]:
    """The frames of a bus logging; channels as the file numbers them.

    Raises ValueError for what is no MF4 file, ImportError where asammdf is missing, and ValueError, which names the program that wrote
    the file, where it reads no frames.
    """
    with path.open("rb") as file:
        if not file.read(8).startswith(MF4):
            raise ValueError("it does not begin with 'MDF ', as an MF4 file does")
    if sys.modules.get("asammdf", can) is None:  # kept out by the program
        del sys.modules["asammdf"]
        importlib.reload(mf4)
    import asammdf  # type: ignore[import-not-found,unused-ignore]  # nobody else needs it

    logging.getLogger("asammdf").setLevel(logging.CRITICAL)  # it logs what it raises
    account.note(f"it was read by asammdf {asammdf.__version__}, which does not say what it leaves out")
    try:
        yield from _frames_of_mf4(path, account)
    except Exception as error:  # of asammdf's own kinds too
        raise ValueError(f"{str(error).rstrip('.') or type(error).__name__}; {_writer(path)}") from error


def _writer(path: Path) -> str:
    """Which program wrote an MF4 file, by the eight letters in its first block."""
    with path.open("rb") as file:
        name = re.sub(r"[^\x21-\x7e]", "", file.read(24)[16:].decode("latin-1"))
    return f"its head names '{name}' as the program that wrote it" if name else "its head names no program that wrote it"


def _frames_of_mf4(path: Path, account: Account) -> Iterator[FrameBatch]:
    reader, found = _mf4(path), 0
    try:
        for batch in batches(checked(_with_ids(reader), account)):
            found += len(batch)
            yield batch
        names = [channel.name for group in reader._mdf.groups for channel in group.channels if channel.name not in ("time", "t")]
        if not found and names and not any(name.startswith("CAN_") for name in names):
            raise ValueError(f"it holds signals such as {', '.join(names[:3])}, expected the bus's frames, which these were decoded from")
    finally:
        reader.stop()


def _mf4(path: Path) -> mf4.MF4Reader:
    """Raises ValueError where asammdf does not take the file; what it then says of its half-made objects is nobody's business."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # a torn file is left open
            why = ""
            try:
                return mf4.MF4Reader(path)
            except Exception as error:  # of struct, lxml, and its own
                why = f"{error}" or type(error).__name__
            gc.collect()
        raise ValueError(f"asammdf does not read it, it may be torn: {why}")
    finally:
        sys.unraisablehook = hook


def _with_ids(reader: mf4.MF4Reader) -> Iterator[can.Message]:
    """Without CAN_DataFrame.IDE a file does not say how long its ids are. python-can takes all for 29 bits; the small ones are not."""
    silent = not any("IDE" in channel.name for group in reader._mdf.groups for channel in group.channels)
    for message in reader:
        if silent:
            message.is_extended_id = message.arbitration_id > 0x7FF
        yield message


def checked(messages: Iterator[can.Message], account: Account) -> Iterator[can.Message]:
    """The same. Raises ValueError for what no reader should have taken: SQLite and MCAP hold numbers that are no time, or no id."""
    for message in messages:
        if not (isinstance(message.timestamp, int | float) and abs(message.timestamp) < END_OF_TIME):
            late = isinstance(message.timestamp, int | float) and message.timestamp >= END_OF_TIME
            why = f", and {TOO_LATE.format(message.timestamp)}" if late else ""
            raise ValueError(f"the next message's time is {message.timestamp!r}{why}")
        if not (isinstance(message.arbitration_id, int) and 0 <= message.arbitration_id < 1 << 32):
            raise ValueError(f"the next message's id is {message.arbitration_id!r}")
        if not (isinstance(message.dlc, int) and 0 <= message.dlc < 256 and len(message.data) < 256):
            raise ValueError(f"the next message's length is {message.dlc!r}")
        account.errors += message.is_error_frame
        account.remote += message.is_remote_frame
        yield message


def _check_database(path: Path) -> None:
    """Raises ValueError unless the messages lie there as such: a view or a computed column can go on for ever."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        kinds = [kind for (kind,) in database.execute("SELECT type FROM pragma_table_list WHERE schema = 'main' AND name = 'messages'")]
        computed = database.execute("SELECT count(*) FROM pragma_table_xinfo('messages') WHERE hidden").fetchone()
    if kinds != ["table"] or computed != (0,):
        raise ValueError("the database has no plain table 'messages'")
