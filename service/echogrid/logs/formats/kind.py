"""What a recording without a frame seems to be by its first bytes, where its name says otherwise."""

from __future__ import annotations

import re

FIRST = 512  # bytes that are looked at
BYTES = {
    b"\x1f\x8b": ".gz",
    b"\x28\xb5\x2f\xfd": ".zst",
    b"LOGG": ".blf",
    b"MDF ": ".mf4",
    b"UnFinMF ": ".mf4",
    b"\x89MCAP": ".mcap",
    b"SQLite format 3": ".db",
    b"\xd4\xc3\xb2\xa1": ".pcap",
    b"\xa1\xb2\xc3\xd4": ".pcap",
    b"\x4d\x3c\xb2\xa1": ".pcap",
    b"\xa1\xb2\x3c\x4d": ".pcap",
    b"\x0a\x0d\x0d\x0a": ".pcapng",
}
LINES = {
    ".log": rb"\s*\([\d .:-]+\)\s+\w+ +[0-9A-Fa-f]+",
    ".asc": rb"date \w|base (hex|dec)|\s*\d+\.\d+\s+(CANFD\s+)?\d+\s+(Rx\s+)?[0-9A-Fa-f]+x?\s",
    ".trc": rb";\$FILEVERSION|\s*\d+\)\s+\d",
    ".csv": rb"timestamp,arbitration_id|Time Stamp,ID",
}
WITHOUT_TIMES = rb"\s*\w+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]\s"  # what candump shows by itself
COLOURED = rb"\s*\x1b\["


def hint(first: bytes, ending: str, packing: str) -> str:
    """The end of a sentence about a file of these `first` bytes; empty where they say nothing, or what the name says.

    `ending` and `packing` are those of its name, ".log" and ".gz" or "".
    """
    found = next((kind for sign, kind in BYTES.items() if first.startswith(sign)), None)
    found = found or next((kind for kind, line in LINES.items() if re.match(line, first)), None)
    if found in (".gz", ".zst"):
        return "" if found == packing else f"; it is packed: give it a name that ends in {ending}{found}"
    if packing and first:
        return f"; it is not packed: give it a name that ends in {found or ending}"
    if found is not None and found != ending:
        return f"; by its first bytes it is a {found} recording: give it a name that ends so"
    if ending == ".log" and re.match(WITHOUT_TIMES, first):
        return "; candump shows no times by itself: record with candump -L, or -l"
    return "; it has colours for a terminal: record with candump -L, or -l" if ending == ".log" and re.match(COLOURED, first) else ""
