"""What other programs write: forms of lines and heads that one meets, each read as what it is, counted by kind, or told."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from pathlib import Path

import pytest
from tests.support import recorded

from echogrid.errors import EchogridError
from echogrid.logs.log import Log
from echogrid.logs.text.dates import seconds_of


def logged(tmp_path: Path, name: str, content: str | bytes) -> Log:
    """A log that has been read to its end, with its frames under `frames` as (time, id, 29 bits, data, channel)."""
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("cp1252"))
    return Log(path)


def short(log: Log) -> list[tuple[float, int, bool, str, str | int | None]]:
    return [(m.timestamp, m.arbitration_id, m.is_extended_id, m.data.hex(), m.channel) for m in log]


@pytest.mark.parametrize(
    ("line", "frame"),
    [
        ("(1.5) can0 123#11.22.33", (1.5, 0x123, False, "112233", "can0")),
        ("(1.5) can0 123#0102030405060708_C", (1.5, 0x123, False, "0102030405060708", "can0")),
        ("(1.5) can0 123#", (1.5, 0x123, False, "", "can0")),
        ("(1.5) can0 00000123#AA T", (1.5, 0x123, True, "aa", "can0")),
        ("  (1.5)  can0  123#aabb  R ", (1.5, 0x123, False, "aabb", "can0")),
        ("(1.5) can0 123##F" + "00" * 12, (1.5, 0x123, False, "00" * 12, "can0")),
        ("(2020-09-13 12:26:40.500000) can0 123#AA", (1600000000.5, 0x123, False, "aa", "can0")),
        (" (1.5)  can0  123   [3]  11 22 33", (1.5, 0x123, False, "112233", "can0")),
        (" (1.5)  can0  RX - -  12345678   [3]  11 22 33   '.\"3'", (1.5, 0x12345678, True, "112233", "can0")),
        (" (1.5)  can0  TX B -  123  [12]  " + " 00" * 12, (1.5, 0x123, False, "00" * 12, "can0")),
        (" (1.5)  can0  123   [8]  remote request", (1.5, 0x123, False, "", "can0")),
    ],
)
def test_lines_of_candump(tmp_path: Path, line: str, frame: tuple[float, int, bool, str, str]) -> None:
    around = "(1.0) can0 001#00\n"
    assert short(logged(tmp_path, "a.log", f"{around}{line}\n{around}"))[1:2] == [frame]


def test_what_candump_writes_beside_frames(tmp_path: Path) -> None:
    lines = [
        "# the car stands from here on",
        "DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)",
        "(1.0) can0 45123#81:00:12345678#1122334455667788",
        "(1.0) can0 701#R8",
        "(1.0) can0 20000004#0004000000000000",
        " (1.0)  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME",
        "\tcontroller-problem{rx-overflow}",
        "(1.0) can0 123#AA",
    ]
    log = logged(tmp_path, "a.log", "\n".join(lines) + "\n")
    frames = list(log)
    assert [(m.is_remote_frame, m.is_error_frame) for m in frames] == [(True, False), (False, True), (False, True), (False, False)]
    assert frames[0].dlc == 8
    assert (log.account.errors, log.account.remote, log.account.odd) == (2, 1, 0)
    assert log.account.others == {"comments": 2, "notices of dropped frames": 1, "CAN XL frames": 1}
    assert "dropped 3 CAN frames" in log.account.notes[0]


@pytest.mark.parametrize(
    "line",
    [
        "(1.0) can0 123#A",
        "(1.0) can0 123#" + "00" * 9,
        "(1.0) can0 12#00",
        "(1.0) can0 123",
        "(x) can0 123#00",
        "can0 123#00",
        "(1.0) 123#00",
        "(1.0) can0 9FFFFFFF#00",
    ],
)
def test_a_line_that_is_none_is_told_by_number_and_text(tmp_path: Path, line: str) -> None:
    log = logged(tmp_path, "a.log", f"(1.0) can0 001#00\n{line}\n(2.0) can0 002#00\n")
    frames = []
    with pytest.raises(EchogridError, match=r"a.log: 1 of its parts could not be understood, the first is line 2: '") as caught:
        frames.extend(iter(log))
    assert line[:50] in str(caught.value)
    assert [m.arbitration_id for m in frames] == [1, 2]


@pytest.mark.parametrize("name", ["a.log", "a.asc", "a.trc", "a.csv", "g.csv"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf", b"utf-16"])
@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_any_code_page_and_line_end(tmp_path: Path, name: str, mark: bytes, end: bytes) -> None:
    """A comment in cp1252, marks of byte order, what Windows and old Macs end lines with."""
    frame = [
        recorded.can.Message(timestamp=1600000000.0 + n, arbitration_id=5, is_extended_id=False, data=b"12", channel="can0")
        for n in range(3)
    ]
    if name == "a.csv":
        lines = (recorded.by_python_can(tmp_path / "p.csv", frame)).read_text().splitlines()
    else:
        lines = {"a.log": recorded.candump, "a.asc": recorded.asc, "a.trc": recorded.trc, "g.csv": recorded.gvret}[name](frame)
    comment = {"a.log": "# J\xfcrgen", "a.asc": "// J\xfcrgen", "a.trc": "; C:\\J\xfcrgen"}.get(name)
    lines = lines[:3] + [comment] * (comment is not None) + lines[3:]
    if mark == b"utf-16":
        data = end.decode().join([*lines, ""]).encode("utf-16")
    else:
        data = mark + end.join([line.encode("cp1252") for line in lines] + [b""])
    assert [m.data for m in logged(tmp_path, name, data)] == [b"12"] * 3


ASC_HEAD = "date Sun Sep 13 12:26:40.000 pm 2020\nbase hex  timestamps absolute\n"


def test_asc_with_a_short_head_keeps_its_first_frame(tmp_path: Path) -> None:
    for head in ("", "base hex\n", ASC_HEAD, "date Sun Sep 13 12:26:40.000 pm 2020\n"):
        log = logged(tmp_path, "a.asc", head + "0.1 1 123 Rx d 1 aa\n0.2 1 124x Rx d 1 bb\n")
        assert [m.arbitration_id for m in log] == [0x123, 0x124]
        assert log.times.notes() == ([] if "date" in head else ["it has no date: its times count from the beginning of 1970"])


def test_what_is_in_asc_beside_frames(tmp_path: Path) -> None:
    lines = [
        "no internal events logged",
        "// version 13.0.0",
        "Begin TriggerBlock Sun Sep 13 12:26:40.000 pm 2020",
        "   0.000000 Start of measurement",
        "   0.1 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%",
        "   0.1 CAN 1 Status:chip status error active",
        "   0.2 1  ErrorFrame\tECC: 10100010",
        "   0.2 CANFD   1 Rx   ErrorFrame    Arb.  Data    0 0 0",
        "   0.3 1  OverloadFrame",
        "   0.3 1  123  TxRq d 1 aa",
        "   0.3 1  123  Tx d 1 aa Length = 0 BitCount = 0 ID = 291",
        "   0.4 CANXL 1 Rx 1 0 8",
        "   0.4 Li 3c Rx 8 00 00",
        "   0.4 ETH 1 Rx 60:ffff",
        "   0.4 Fr RMSG 0 0 1 1",
        "   0.4 SV: 2 0 1 ::speed = 3",
        "   0.4 1  J1939TP FEE3p 6 0 0 - Rx d 23",
        "   0.5 2  18EBFF00x Rx d 2 01 02",
        "   0.5 1  124  Rx r 8",
        "   0.6 CANFD 1 Tx 300 SomeName 1 0 9 12 " + "00 " * 12 + " 130000 130 303000 e0006659 46500250 4b140250 20011736 2001040d",
        "   0.7 CANFD 1 Rx 101 0 0 2 2 01 02 130000 130 200000 0 0 0 0 0",
        "End TriggerBlock",
    ]
    log = logged(tmp_path, "a.asc", ASC_HEAD + "\n".join(lines) + "\n")
    frames = list(log)
    assert [(m.arbitration_id, m.is_fd, m.dlc, m.channel, m.is_rx) for m in frames if not (m.is_error_frame or m.is_remote_frame)] == [
        (0x123, False, 1, 1, False),
        (0x18EBFF00, False, 2, 2, True),
        (0x300, True, 12, 1, False),
        (0x101, False, 2, 1, True),  # a frame of CAN on a channel of CAN FD
    ]
    assert (log.account.errors, log.account.remote, log.account.odd) == (2, 1, 0)
    assert log.account.others["requests to send"] == 1
    assert sum(log.account.others.values()) == 12
    assert [round(m.timestamp - 1600000000, 3) for m in frames] == [0.2, 0.2, 0.3, 0.5, 0.5, 0.6, 0.7]


@pytest.mark.parametrize(
    "line", ["0.1 1 800 Rx d 1 00", "0.1 1 123 Rx d 2 00", "0.1 1 Name Rx d 1 00", "0.1 CANFD 1 Rx 300 1 0 9 12 00", "0.1 1 1g Rx d 1 00"]
)
def test_a_frame_of_asc_that_is_none_is_told(tmp_path: Path, line: str) -> None:
    log = logged(tmp_path, "a.asc", ASC_HEAD + f"0.1 1 123 Rx d 1 00\n{line}\n0.2 1 123 Rx d 1 00\n")
    with pytest.raises(EchogridError, match="1 of its parts could not be understood, the first is line 4: "):
        list(log)
    assert log.messages == 2


def test_trigger_blocks_of_asc(tmp_path: Path) -> None:
    """Times go on from the measurement's start, or begin again with each block; what the head dates may be the writing."""
    frame, block = "{} 1 123 Rx d 1 00\n", "Begin TriggerBlock Sun Sep 13 12:{} pm 2020\n"
    for blocks, expected in (
        ([("26:40.000", 0.0), ("28:20.000", 100.0)], [0, 100]),
        ([("26:50.000", 10.0), ("28:20.000", 100.0)], [10, 100]),
        ([("26:40.000", 0.0), ("28:20.000", 0.0)], [0, 100]),
        ([("46:40.000", 0.5)], [1200.5]),
        ([("26:40.000", 0.0), ("26:40.000", 50.0)], [0, 50]),
    ):
        text = ASC_HEAD + "".join(block.format(date) + frame.format(time) for date, time in blocks)
        assert [m.timestamp - 1600000000 for m in logged(tmp_path, "a.asc", text)] == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Sun Sep 13 12:26:40.000 pm 2020", "2020-09-13T12:26:40"),
        ("Son Sep 13 12:26:40 2020", "2020-09-13T12:26:40"),
        ("Die M\xe4r 3 03:06:13.191 pm 2020", "2020-03-03T15:06:13.191"),
        ("Don Dez 24 15:06:13.191 pm 2020", "2020-12-24T15:06:13.191"),
        ("Mit Okt 07 12:00:01 am 2020", "2020-10-07T00:00:01"),
        ("13.09.2020 12:26:40.123.4", "2020-09-13T12:26:40.123"),
        ("2020-09-13 12:26:40+00:00", "2020-09-13T12:26:40"),
        ("mar. ao\xfbt 4 09:08:07 2020", "2020-08-04T09:08:07"),
        ("Wed Feb 30 09:08:07 2020", None),
        ("12:26:40", None),
        ("some day", None),
    ],
)
def test_dates(text: str, expected: str | None) -> None:
    assert seconds_of(text) == (None if expected is None else datetime.fromisoformat(expected).replace(tzinfo=UTC).timestamp())


def test_a_date_in_a_code_page_or_none(tmp_path: Path) -> None:
    frame = "0.5 1 123 Rx d 1 00\n"
    (one,) = logged(tmp_path, "a.asc", f"date Die M\xe4r 3 03:06:13.191 pm 2020\n{frame}")
    assert one.timestamp == pytest.approx(datetime(2020, 3, 3, 15, 6, 13, 691000, tzinfo=UTC).timestamp())
    log = logged(tmp_path, "a.asc", f"date some day\n{frame}")
    assert [m.timestamp for m in log] == [0.5]
    assert log.account.notes == ["its date 'some day' cannot be read"]


START_TIME = ";$STARTTIME=44087.5185185185"
TRC = {  # as PEAK's description of the format shows them
    "1.0": [
        ";   Start time: 13.09.2020 12:26:40.000.0",
        "     1)  1841  0001  8  00 01 02 03 04 05 06 07",
        "     2)  1842  00000008  2 00 01",
        "     3)  1843  0002  4 RTR",
        "     4)  1844  FFFFFFFF  4  00 00 00 08 BUSHEAVY",
    ],
    "1.1": [
        ";$FILEVERSION=1.1",
        START_TIME,
        "     1)  1841.1  Rx  0001  8  00 01 02 03 04 05 06 07",
        "     2)  1842.2  Tx  00000008  2  00 01",
        "     3)  1843.3  Rx  0002  4  RTR",
        "     4)  1844.4  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY",
        "     5)  1845.0  Error  0008  4  00 19 08 08",
    ],
    "1.2": [
        ";$FILEVERSION=1.2",
        START_TIME,
        "     1)  1841.1 1  Rx  0001  8  00 01 02 03 04 05 06 07",
        "     2)  1842.2 1  Tx  00000008  2  00 01",
        "     3)  1843.3 2  Rx  0002  4  RTR",
        "     4)  1844.4 1  Warng  FFFFFFFF  4  00 00 00 08  BUSHEAVY",
        "     5)  1845.0 1  Error  0008  4  00 19 08 08",
    ],
    "1.3": [
        ";$FILEVERSION=1.3",
        START_TIME,
        "     1)  1841.1 1  Rx  0001 -  8  00 01 02 03 04 05 06 07",
        "     2)  1842.2 1  Tx  00000008 -  2  00 01",
        "     3)  1843.3 2  Rx  0002 -  4  RTR",
        "     4)  1844.4 1  Warng  FFFFFFFF -  4  00 00 00 08  BUSHEAVY",
        "     5)  1845.0 1  Error  0008 -  4  00 19 08 08",
    ],
    "2.0": [
        ";$FILEVERSION=2.0",
        START_TIME.replace(".", ","),
        ";$COLUMNS=N,O,T,I,d,l,D",
        "      1  1841.100 DT     0001 Rx 8  00 01 02 03 04 05 06 07",
        "      2  1842.200 DT 00000008 Tx 2  00 01",
        "      3  1843.300 RR     0002 Rx 4",
        "      4  1844.400 ST          Rx    00 00 00 08",
        "      5  1845.000 ER          Rx    04 00 02 00 00",
        "      6  1846.000 EC          Rx    02 02",
        "      7  1847.000 EV  an event",
    ],
    "2.1": [
        ";$FILEVERSION=2.1",
        START_TIME,
        ";$COLUMNS=N,O,T,B,I,d,R,L,D",
        "      1  1841.100 DT 1      0001 Rx -  8    00 01 02 03 04 05 06 07",
        "      2  1842.200 DT 1  00000008 Tx -  2    00 01",
        "      3  1843.300 RR 2      0002 Rx -  4",
        "      4  1844.400 ST 1         - Rx -  4    00 00 00 08",
        "      5  1845.000 ER 1         - Rx -  5    04 00 02 00 00",
        "      6  1846.000 EC 1         - Rx -  2    02 02",
        "      7  1847.000 EV 1  an event",
    ],
}


@pytest.mark.parametrize("version", TRC)
@pytest.mark.parametrize("with_head", [True, False])
def test_versions_of_trc(tmp_path: Path, version: str, with_head: bool) -> None:
    """Old versions are told apart by their lines as well."""
    left_out = "\0" if with_head else ";$COLUMNS" if version >= "2" else ";"
    text = "\n".join(line for line in TRC[version] if not line.startswith(left_out)) + "\n"
    log = logged(tmp_path, "a.trc", text)
    frames = list(log)
    data = [m for m in frames if not m.is_error_frame]
    assert [(m.arbitration_id, m.is_extended_id, m.is_remote_frame, m.dlc, m.data.hex()) for m in data] == [
        (1, False, False, 8, "0001020304050607"),
        (8, True, False, 2, "0001"),
        (2, False, True, 4, ""),
    ]
    assert [m.channel for m in data] == ([1, 1, 2] if version in ("1.2", "1.3", "2.1") else [None] * 3)
    assert log.account.errors == (version != "1.0")
    assert log.account.odd == 0
    assert log.account.others["states of the controller"] == 1
    start = 1600000000 if with_head or version >= "2" else 0
    assert frames[0].timestamp == pytest.approx(start + 1.841, abs=2e-3)


def test_length_codes_of_trc_are_bytes_in_a_frame(tmp_path: Path) -> None:
    """Columns L and l alike."""
    head = ";$FILEVERSION=2.1\n;$STARTTIME=44087.5185185185\n;$COLUMNS=N,O,T,B,I,d,R,{},D\n"
    for column, length in (("L", 15), ("l", 64)):
        (frame,) = logged(tmp_path, "a.trc", head.format(column) + f"  1  0.000 FB 1 0300 Rx - {length} {'00 ' * 64}\n")
        assert (frame.dlc, len(frame.data), frame.is_fd, frame.bitrate_switch) == (64, 64, True, True)


def test_a_classic_frame_of_blf_has_8_bytes_whatever_its_code(tmp_path: Path) -> None:
    body = struct.pack("<HBBI8s", 1, 0, 15, 0x100, b"12345678")
    (frame,) = logged(tmp_path, "a.blf", recorded.joined(recorded.blf([recorded.blf_object(1, body)], 1600000000)))
    assert (frame.dlc, bytes(frame.data)) == (8, b"12345678")


def test_error_frames_of_blf(tmp_path: Path) -> None:
    old = recorded.blf_object(2, struct.pack("<HH", 3, 0))
    new = recorded.blf_object(73, struct.pack("<HHIBBBxIIH2x8s", 2, 0, 0, 0, 0, 4, 0, 0x123, 0, b"12345678"))
    log = logged(tmp_path, "a.blf", recorded.joined(recorded.blf([old, new], 1600000000)))
    assert [(m.is_error_frame, m.channel, m.data.hex()) for m in log] == [(True, 3, ""), (True, 2, "31323334")]
    assert log.account.errors == 2


def test_gvret_of_old_and_with_seconds(tmp_path: Path) -> None:
    old = "Time Stamp,ID,Extended,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n1000000,00000123,false,1,2,A,BB,\n2000000,12345678,true,0,0,\n"
    assert short(logged(tmp_path, "a.csv", old)) == [(1.0, 0x123, False, "0abb", "can1"), (2.0, 0x12345678, True, "", "can0")]
    new = "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n1600000000.5,0x123,0,Tx,0,1,0F,,,,,,,\n"
    assert short(logged(tmp_path, "a.csv", new)) == [(1600000000.5, 0x123, False, "0f", "can0")]


def test_captures_of_something_else_are_refused_with_what_they_hold(tmp_path: Path) -> None:
    ethernet = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1) + bytes(40)
    with pytest.raises(EchogridError, match=r"its link type is 1 \(Ethernet\), expected 227 \(SocketCAN\)$"):
        list(logged(tmp_path, "a.pcap", ethernet))
    section = recorded.pcapng([])[0]
    interface = recorded.block(1, struct.pack("<HHI", 1, 0, 0))
    with pytest.raises(EchogridError, match=r"its link type is 1 \(Ethernet\), expected 227 \(SocketCAN\)$"):
        list(logged(tmp_path, "a.pcapng", section + interface))
    everywhere = recorded.block(1, struct.pack("<HHI", 276, 0, 0))
    with pytest.raises(
        EchogridError, match=r"its link types are 1 \(Ethernet\), 276 \(any interface\), .*: capture the interfaces themselves"
    ):
        list(logged(tmp_path, "b.pcapng", section + interface + everywhere))


def test_captures_hold_errors_and_frames_of_can_xl(tmp_path: Path) -> None:
    error = struct.pack(">IBBxx8s", 0x20000004, 8, 0, bytes(8))
    longer = struct.pack(">IBBHI", 0x123, 0x80, 0, 0x0800, 0) + bytes(8)
    plain = recorded.packet(recorded.can.Message(arbitration_id=5, data=b"1"))
    records = [struct.pack("<IIII", 1600000000, n, len(data), len(data)) + data for n, data in enumerate((error, longer, plain))]
    log = logged(tmp_path, "a.pcap", recorded.pcap([])[0] + b"".join(records))
    assert [(m.is_error_frame, m.arbitration_id) for m in log] == [(True, 4), (False, 5)]
    assert (log.account.errors, dict(log.account.others)) == (1, {"CAN XL frames": 1})


@pytest.mark.parametrize("name", ["a.log", "a.csv"])
def test_steps_from_frame_to_frame_are_added_up(tmp_path: Path, name: str) -> None:
    """candump -t d, which has no head to say so."""
    steps = [0.0, *[0.0003, 0.0097] * 40]
    if name == "a.log":
        text = "".join(f"({step:010.6f}) can0 {0x100 + n % 3:03X}#00\n" for n, step in enumerate(steps))
    else:
        text = "timestamp,arbitration_id,extended,remote,error,dlc,data\n" + "".join(f"{step},0x100,0,0,0,0,\n" for step in steps)
    log = logged(tmp_path, name, text)
    frames = list(log)
    assert [m.timestamp for m in frames] == pytest.approx([sum(steps[: n + 1]) for n in range(len(steps))])
    assert log.account.notes == ["its times are steps from frame to frame, they were added up"]


def test_clocks_of_two_buses_are_no_steps(tmp_path: Path) -> None:
    text = "".join(f"({n / 100:.6f}) can0 100#00\n({n / 100 + 3:.6f}) can1 200#00\n" for n in range(100))
    log = logged(tmp_path, "a.log", text)
    assert [m.timestamp for m in log][:2] == [0.0, 3.0]
    assert log.times.faults() == ["its times go back 99 times, by up to 2.990 s"]
