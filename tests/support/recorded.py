"""Recordings written frame by frame in every format, by writers that know nothing of the service's readers."""

from __future__ import annotations

import struct
import zlib
from base64 import b64encode
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import can
from can.util import len2dlc

Messages = Sequence[can.Message]
DAY_ZERO = datetime(1899, 12, 30, tzinfo=UTC)


def by_python_can(path: Path, messages: Messages) -> Path:
    with can.Logger(path) as logger:
        for message in messages:
            logger.on_message_received(message)
    return path


def number(message: can.Message) -> int:
    """can0 is a file's channel 1."""
    return int(str(message.channel)[3:]) + 1


def candump(messages: Messages) -> list[str]:
    lines = []
    for message in messages:
        identifier = f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"
        flags = f"#{message.bitrate_switch + 2 * message.error_state_indicator:X}" if message.is_fd else ""
        payload = f"R{message.dlc}" if message.is_remote_frame else message.data.hex().upper()
        lines.append(f"({message.timestamp:.6f}) {message.channel} {identifier}#{flags}{payload}")
    return lines


def asc(messages: Messages, timestamps: str = "absolute", base: str = "hex") -> list[str]:
    """As CANoe writes it: a frame of CAN FD has flags, and what was measured of it, behind its data."""
    first = messages[0].timestamp
    when = datetime.fromtimestamp(first, UTC)
    lines = [
        f"date {when:%a %b %d %I:%M:%S}.{when.microsecond // 1000:03} {when:%p %Y}",
        f"base {base}  timestamps {timestamps}",
        "internal events logged",
        "// version 13.0.0",
        f"{0:11.6f} Start of measurement",
    ]
    before, form = 0.0, "{:x}" if base == "hex" else "{}"
    for message in messages:
        at = round(message.timestamp - first, 6)
        shown = at if timestamps == "absolute" else round(at - before, 6)
        before = at
        identifier = form.format(message.arbitration_id) + "x" * message.is_extended_id
        way, payload = "Rx" if message.is_rx else "Tx", " ".join(f"{byte:02x}" if base == "hex" else str(byte) for byte in message.data)
        if message.is_fd:
            bits = f"{message.bitrate_switch:d} {message.error_state_indicator:d}"
            flags = 0x1000 | message.bitrate_switch << 13 | message.error_state_indicator << 14
            length = f"{form.format(len2dlc(len(message.data)))} {len(message.data):2}"
            measured = f"130000  130 {flags:8x} 0 0 0 0 0"
            lines.append(f"{shown:11.6f} CANFD {number(message):3} {way} {identifier:>8}  {'':32} {bits} {length} {payload} {measured}")
        else:
            what = f"r {message.dlc:x}" if message.is_remote_frame else f"d {len(message.data)} {payload}"
            lines.append(
                f"{shown:11.6f} {number(message)}  {identifier:15} {way:4} {what}  Length = 0 BitCount = 0 ID = {message.arbitration_id}"
            )
    return [*lines, "End TriggerBlock"]


def trc(messages: Messages, version: str = "2.1") -> list[str]:
    """As PEAK's programs write it; before 2.0 without CAN FD."""
    first = messages[0].timestamp
    when = datetime.fromtimestamp(first, UTC)
    days = (when - DAY_ZERO).total_seconds() / 86400
    columns = {"2.0": "N,O,T,I,d,l,D", "2.1": "N,O,T,B,I,d,R,L,D"}
    lines = [f";$FILEVERSION={version}", f";$STARTTIME={days:.13f}"] if version != "1.0" else []
    lines += [f";$COLUMNS={columns[version]}"] if version in columns else []
    lines += [
        ";",
        ";   C:\\traces\\a.trc",
        f";   Start time: {when:%d.%m.%Y %H:%M:%S}.{when.microsecond // 1000:03}.0",
        ";---+--   ----+----",
    ]
    for count, message in enumerate(messages, 1):
        at = (message.timestamp - first) * 1000
        identifier = f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:04X}"
        way, payload = "Rx" if message.is_rx else "Tx", "RTR" if message.is_remote_frame else message.data.hex(" ").upper()
        length, bus = message.dlc if message.is_remote_frame else len(message.data), number(message)
        kind = {(0, 0): "FD", (1, 0): "FB", (1, 1): "FE", (0, 1): "BI"}[message.bitrate_switch, message.error_state_indicator]
        kind = "RR" if message.is_remote_frame else kind if message.is_fd else "DT"
        payload = payload if version < "2" else payload.replace("RTR", "")
        lines.append(
            {
                "1.0": f"{count:6})  {at:8.0f}  {identifier:>8}  {length} {payload}",
                "1.1": f"{count:6})  {at:10.1f}  {way}     {identifier:>8}  {length}  {payload}",
                "1.2": f"{count:6})  {at:10.1f} {bus}  {way}     {identifier:>8}  {length}  {payload}",
                "1.3": f"{count:6})  {at:10.1f} {bus}  {way}     {identifier:>8} -  {length}    {payload}",
                "2.0": f"{count:7} {at:13.3f} {kind} {identifier:>8} {way} {length}  {payload}",
                "2.1": f"{count:7} {at:13.3f} {kind} {bus} {identifier:>8} {way} -  {len2dlc(length):<2}  {payload}",
            }[version]
        )
    return lines


def gvret(messages: Messages) -> list[str]:
    """As SavvyCAN saves it: microseconds, buses from 0."""
    lines = ["Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"]
    for message in messages:
        extended, way, payload = str(message.is_extended_id).lower(), "Rx" if message.is_rx else "Tx", message.data.hex(",").upper()
        time, length = round(message.timestamp * 1e6), len(message.data)
        lines.append(f"{time},{message.arbitration_id:08X},{extended},{way},{number(message) - 1},{length},{payload},")
    return lines


def python_can_csv(messages: Messages) -> list[str]:
    """As python-can's CSVWriter; without channels and flags of CAN FD."""
    lines = ["timestamp,arbitration_id,extended,remote,error,dlc,data"]
    for message in messages:
        flags = f"{message.is_extended_id:d},{message.is_remote_frame:d},{message.is_error_frame:d}"
        data = b64encode(message.data).decode()
        lines.append(f"{message.timestamp!r},0x{message.arbitration_id:x},{flags},{message.dlc},{data}")
    return lines


def packet(message: can.Message) -> bytes:
    """SocketCAN's frame as libpcap writes it: the id in network order."""
    code = message.arbitration_id | message.is_extended_id << 31 | message.is_remote_frame << 30 | message.is_error_frame << 29
    flags = 4 | message.bitrate_switch | message.error_state_indicator << 1 if message.is_fd else 0
    length = message.dlc if message.is_remote_frame else len(message.data)
    return struct.pack(">IBBxx", code, length, flags) + bytes(message.data).ljust(64 if message.is_fd else 8, b"\0")


def pcap(messages: Messages, order: str = "<", nanoseconds: bool = False) -> list[bytes]:
    """Head and records."""
    parts = [struct.pack(order + "IHHiIII", 0xA1B23C4D if nanoseconds else 0xA1B2C3D4, 2, 4, 0, 0, 65535, 227)]
    for message in messages:
        seconds, micros = divmod(round(message.timestamp * 1e6), 1_000_000)
        data = packet(message)
        parts.append(struct.pack(order + "IIII", seconds, micros * (1000 if nanoseconds else 1), len(data), len(data)) + data)
    return parts


def block(kind: int, body: bytes, order: str = "<") -> bytes:
    """Of pcapng."""
    body += bytes(-len(body) % 4)
    return struct.pack(order + "II", kind, len(body) + 12) + body + struct.pack(order + "I", len(body) + 12)


def pcapng(messages: Messages, order: str = "<", named: bool = True) -> list[bytes]:
    """Section, two interfaces (the second in nanoseconds), statistics, and packets."""
    section = block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1), order)
    parts = [section]
    for index in range(2):
        options = struct.pack(order + "HH4s", 2, 4, f"can{index}".encode()) if named else b""
        options += struct.pack(order + "HHB3x", 9, 1, 9) * index + bytes(4)
        parts.append(block(1, struct.pack(order + "HHI", 227, 0, 0) + options, order))
    parts.append(block(5, struct.pack(order + "III", 0, 0, 0), order))
    for message in messages:
        index = number(message) - 1
        ticks, data = round(message.timestamp * 1e6) * (1, 1000)[index], packet(message)
        parts.append(block(6, struct.pack(order + "IIIII", index, ticks >> 32, ticks & 0xFFFFFFFF, len(data), len(data)) + data, order))
    return parts


def blf_object(kind: int, body: bytes, stamp_ns: int = 0, version: int = 1) -> bytes:
    header = struct.pack("<IHHQ", 2, 0, 0, stamp_ns) if version == 1 else struct.pack("<IBxHQ8x", 2, 0, 0, stamp_ns)
    size = 16 + len(header) + len(body)
    return struct.pack("<4sHHII", b"LOBJ", 16 + len(header), version, size, kind) + header + body + bytes(size % 4)


def blf_frame(message: can.Message, start: float, version: int = 1, kind: int | None = None) -> bytes:
    """CAN (1, 86), CAN FD (100) and CAN FD with a short body (101)."""
    kind = kind or (100 if message.is_fd else 86)
    code = message.arbitration_id | message.is_extended_id << 31
    stamp_ns = round((message.timestamp - start) * 1e6) * 1000
    data, length = bytes(message.data), len(message.data)
    sent, remote = not message.is_rx, message.is_remote_frame
    code_for = len2dlc(length)
    if kind == 101:
        flags = remote << 4 | message.is_fd << 12 | message.bitrate_switch << 13 | message.error_state_indicator << 14
        body = struct.pack("<BBBBIIIIIIIHBBI", number(message), code_for, length, 0, code, 0, flags, 0, 0, 0, 0, 0, sent, 0, 0) + data
    elif kind == 100:
        flags = message.is_fd | message.bitrate_switch << 1 | message.error_state_indicator << 2
        body = struct.pack("<HBBIIBBB5x64s", number(message), sent | remote << 7, code_for, code, 0, 0, flags, length, data)
    else:
        dlc = message.dlc if remote else length
        body = struct.pack("<HBBI8s", number(message), sent | remote << 7, dlc, code, data) + bytes(8 if kind == 86 else 0)
    return blf_object(kind, body, stamp_ns, version)


def blf_container(data: bytes, packed: bool = True) -> bytes:
    body = struct.pack("<H6xI4x", 2 if packed else 0, len(data)) + (zlib.compress(data) if packed else data)
    return struct.pack("<4sHHII", b"LOBJ", 16, 1, 16 + len(body), 10) + body + bytes((16 + len(body)) % 4)


def blf(objects: Sequence[bytes], start: float, size: int = 1 << 12, packed: bool = True) -> list[bytes]:
    """Head and containers; an object may begin in one and end in the next. The head says how large all is."""
    data = b"".join(objects)
    containers = [blf_container(data[at : at + size], packed) for at in range(0, len(data), size)]
    when = datetime.fromtimestamp(start, UTC)
    date = (when.year, when.month, 0, when.day, when.hour, when.minute, when.second, when.microsecond // 1000)
    total = 144 + sum(map(len, containers))
    head = struct.pack("<4sI8BQQII8H8H", b"LOGG", 144, *[0] * 8, total, 144 + len(data), len(objects), 0, *date, *date).ljust(144, b"\0")
    return [head, *containers]


Writer = Callable[[Messages], "list[str] | list[bytes]"]


def joined(parts: Sequence[str] | Sequence[bytes]) -> bytes:
    return b"".join(part if isinstance(part, bytes) else part.encode() + b"\n" for part in parts)
