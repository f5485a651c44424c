"""DBC files as they are: what does not matter is passed over, what is used is sound; cantools and opendbc's files as witnesses."""

from __future__ import annotations

import gc
import logging
import math
import re
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cantools.database.can import Database as ByCantools
from hypothesis import given
from hypothesis import strategies as st
from tests.support.places import DBC

from echogrid.can import dbc, dbc_file, foreign_database
from echogrid.can.database import Database
from echogrid.can.dbc import Dbc
from echogrid.can.decode import BatchDecoder, stack
from echogrid.can.motion import MotionReader
from echogrid.can.profile import find, load_motion, load_radar
from echogrid.can.radar import RadarReader
from echogrid.config.tables import Motion
from echogrid.core.health import Health, SensorHealth
from echogrid.errors import EchogridError

MOTION = (DBC / "vehicle_motion.dbc").read_text()
MESSAGES = dbc_file.parse(MOTION.encode()).messages
OF_NO_CONSEQUENCE = [
    'VAL_ 258 NoSuchSignal 0 "off" 1 "on" ;',
    'VAL_ 258 YawRate 0 "open ;',
    'VAL_ 4711 Nowhere 0 "off";',
    'CM_ 258 "said of a message";',
    'CM_ SG_ 258 "said of nothing";',
    'CM_ SG_ 258 YawRate "said "twice" over";',
    'CM_ "no semicolon"',
    'CM_ "a string that never ends;',
    'CM_ SG_ 258 YawRate "over lines,\nBO_ 258 YawRate: 8 X\n SG_ YawRate : 0|1@1+ (1,0) [0|1] x X\n among them";',
    "BS_: 500000 : 0,0",
    'BA_ "GenMsgCycleTime" BO_ 258 .5;',
    'BA_DEF_ BO_ "Odd" ENUM "a","b;',
    "EV_ Odd: 0 [0|0] 0 0 DUMMY_NODE_VECTOR0",
    "SIG_GROUP_ 258 Odd 1 : YawRate",
    "FILTER",
    "// a remark",
    "",
    "a line of nothing at all",
    "BO_TX_BU_ 258",
    "\tNS_DESC_",
]
ELSEWHERE = [
    'BO_ 316543911 Elsewhere: 8 Vehicle\n SG_ A : 0|8@1+ (1,0) [0|255] "" EchoGrid',
    'BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX\n SG_ Loose : 0|8@1+ (1,0) [0|0] "" Vector__XXX',
    'BO_ 1275 2017_5: 8 XXX\n SG_ 2ndGear : 0|8@1+ (.25,-.5) [0|255] "" XXX',
    'BO_ 99999999999 Huge: 8 V\n SG_ A : 0|8@1+ (1,0) [0|255] "" V',
    "BO_ -3 Negative: 8 V",
    'BO_ 400 Broken: 8 V\n SG_ A : 0|8@ (1,0)\n SG_ B : 0|8@1+ (one,0) [0|1] "" V\n SG_ C',
    'SG_ Homeless : 0|8@1+ (1,0) [0|255] "" EchoGrid',
    "SIG_VALTYPE_ 400 A : x;",
    "SG_MUL_VAL_ 400 A B;",
]
ODD = OF_NO_CONSEQUENCE + [lines for lines in ELSEWHERE if not lines.startswith("SG_ ")]  # which would be of the message before


def _motion_with(*lines: str) -> Database:
    return dbc_file.parse("\n".join((MOTION, *lines)).encode())


def _dbc(folder: Path, text: str | bytes) -> Dbc:
    path = folder / "some.dbc"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return Dbc(path, folder / "profile.toml")


def _refusal(dbc: Dbc, message: str, signal: str) -> str:
    """One sentence on why the signal cannot be used; empty where it can."""
    try:
        dbc.signal(dbc.message(message, "key"), signal, "key")
    except EchogridError as error:
        said = str(error)
    else:
        return ""
    assert said
    assert "\n" not in said
    return said


@given(st.lists(st.tuples(st.sampled_from(ODD), st.integers(0, 30)), max_size=6))
def test_odd_lines_change_no_message_beside_them(odd: list[tuple[str, int]]) -> None:
    """At any place between the statements of a sound file."""
    blocks = MOTION.split("\n\n")
    for line, place in odd:
        blocks.insert(place % (len(blocks) + 1), line)
    read = dbc_file.parse("\n\n".join(blocks).encode())
    assert [message for message in read.messages if message in MESSAGES] == list(MESSAGES)


@pytest.mark.parametrize("line", ELSEWHERE[:1] + ELSEWHERE[3:])
def test_what_is_left_out_is_named_with_its_line(line: str) -> None:
    read = _motion_with(line)
    first = MOTION.count("\n") + 1
    assert read.left_out
    for sentence in read.left_out:
        assert first <= int(re.findall(r"^line (\d+): ", sentence)[0]) <= first + line.count("\n") + 1
        assert "\n" not in sentence


@pytest.mark.parametrize("line", OF_NO_CONSEQUENCE)
def test_what_says_nothing_of_bits_is_not_even_named(line: str) -> None:
    assert _motion_with(line).left_out == ()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252", "latin-1"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_any_code_page_and_line_end(encoding: str, newline: str) -> None:
    text = (MOTION + 'CM_ "° Lenkwinkel größer";\n').replace("\n", newline)
    assert dbc_file.parse(text.encode(encoding)).messages == MESSAGES


def test_a_name_beyond_ascii_is_found_in_either_code_page(tmp_path: Path) -> None:
    text = MOTION.replace("WheelSpeedRL ", "Rädchen ")
    for encoding in ("utf-8", "cp1252"):
        dbc = _dbc(tmp_path, text.encode(encoding))
        assert dbc.signal(dbc.message("WheelSpeedsRear", "key"), "Rädchen", "key")


@given(st.binary(max_size=400), st.integers(0, len(MOTION)), st.integers(0, 40))
def test_any_bytes_end(junk: bytes, at: int, cut: int) -> None:
    """Wherever they stand, and whatever they replace."""
    data = MOTION.encode()
    dbc_file.parse(data[:at] + junk + data[at + cut :])


def test_long_files_take_time_in_proportion() -> None:
    """Inputs that invite a regular expression to go back and forth: with time in proportion these are a matter of a second."""
    for text in (
        'BO_ 1 A: 8 V\n SG_ A : 0|8@1+ (1,0) [0|1] "' + "\n" * 200_000,
        'CM_ "\n' * 50_000,
        "SG_ A " * 50_000,
        "BO_ 1 A: 8 V " * 50_000,
    ):
        dbc_file.parse(text.encode())


def test_a_file_without_messages_is_refused_in_one_sentence(tmp_path: Path) -> None:
    for data in (b"\x89PNG\r\n\x1a\n" + bytes(range(256)), b"", b"BO_ "):
        with pytest.raises(EchogridError, match=r"some.dbc: is no DBC file: it has no message") as caught:
            _dbc(tmp_path, data)
        assert "\n" not in str(caught.value)


def test_lines_that_are_left_out_are_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        for _ in range(4):
            _dbc(tmp_path, MOTION + ELSEWHERE[0])
    assert sum("Elsewhere" in record.message for record in caplog.records) == 1


OTHER = "BO_ 1 Other: 8 V\n"
MULTIPLEXED = """BO_ 258 YawRate: 4 V
 SG_ Branch{mark} : 0|8@1+ (1,0) [0|1] "" E
 SG_ Turn m0 : 16|16@1- (0.0002,0) [-6|6] "rad/s" E
"""


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (MULTIPLEXED.replace("{mark}", ""), "no signal decides when 'Turn' is there"),
        (MULTIPLEXED.replace("{mark}", "").replace(" m0", " m"), "no signal decides when 'Turn' is there"),
        (MULTIPLEXED.replace("{mark}", " M") + ' SG_ Other M : 8|8@1+ (1,0) [0|1] "" E\n', "no signal decides when 'Turn' is there"),
        (MULTIPLEXED.replace("{mark}", " M") + "SG_MUL_VAL_ 258 Turn Gone 0-1;\n", "no signal decides when 'Turn' is there"),
        (MULTIPLEXED.replace("{mark}", " M") + "SG_MUL_VAL_ 258 Turn Turn 0-1;\n", "no signal decides when 'Turn' is there"),
        (MULTIPLEXED.replace("{mark}", " M") + "SG_MUL_VAL_ 258 Turn Branch;\n", "line 5: is no SG_MUL_VAL_ that is understood"),
        (MULTIPLEXED.replace("{mark}", " M") + "SIG_VALTYPE_ 258 Turn : 7;\n", "line 5: is no SIG_VALTYPE_ that is understood"),
        (MULTIPLEXED.replace("{mark}", " M") + "SIG_VALTYPE_ 258 Turn : 1;\n", "'Turn' of 16 bits is said to be a float of 32"),
        (MULTIPLEXED.replace("{mark}", " M").replace("16|16", "16|17"), "is not a number within its 4 bytes"),
        (MULTIPLEXED.replace("{mark}", " M").replace("0.0002", "0"), "has the scale 0"),
        (
            MULTIPLEXED.replace("{mark}", " M").replace("0.0002", "0,0002"),
            "line 4: the layout of signal 'Turn' of message 'YawRate' is not",
        ),
        (MULTIPLEXED.replace("{mark}", " M").replace("0|8@1", "0|8@2"), "no signal decides when 'Turn' is there"),
        (MULTIPLEXED.replace("258", "316543911"), "line 2: message 'YawRate' has the id 316543911, expected one of 11 bits, or 2464027559"),
        (MULTIPLEXED.replace(": 4 V", ": four V"), "line 2: is no BO_ with id, name and length"),
        (
            MULTIPLEXED + MULTIPLEXED.replace("258", "1026"),
            "message 'YawRate' is there 2 times, with the ids 0x102 and 0x402, expected once",
        ),
        (
            MULTIPLEXED.replace("{mark}", " M") + ' SG_ Turn m0 : 8|8@1+ (1,0) [0|1] "" E\n',
            "'Turn' twice, not in branches that exclude each other",
        ),
        (
            MULTIPLEXED.replace("{mark}", " M") + ' SG_ Turn : 8|8@1+ (1,0) [0|1] "" E\n',
            "'Turn' twice, not in branches that exclude each other",
        ),
    ],
)
def test_what_is_used_is_sound_or_refused_in_one_sentence(tmp_path: Path, text: str, complaint: str) -> None:
    said = _refusal(_dbc(tmp_path, OTHER + text.replace("{mark}", " M")), "YawRate", "Turn")
    assert complaint in said
    assert "some.dbc: " in said


@given(st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=8), st.permutations([0, 1, 2]))
def test_a_name_in_several_branches_is_that_of_the_branch_that_is_there(payloads: list[bytes], order: list[int]) -> None:
    lines = [
        ' SG_ Turn m1 : 16|16@1- (0.5,0) [0|0] "" E',
        ' SG_ Turn m2 : 39|16@0+ (3,-7) [0|0] "" E',
        ' SG_ Plain : 8|8@1+ (1,0) [0|0] "" E',
    ]
    text = 'BU_: V E\n\nBO_ 258 A: 8 V\n SG_ Which M : 0|2@1+ (1,0) [0|0] "" E\n' + "\n".join(lines[i] for i in order) + "\n"
    (message,) = dbc_file.parse(text.encode()).messages
    decoded = BatchDecoder(message, ["Turn", "Plain"]).decoded(stack(payloads, 8))
    for row, raw, there, payload in zip(decoded.physical, decoded.raw, decoded.there, payloads, strict=True):
        little, big = int.from_bytes(payload[2:4], "little", signed=True), int.from_bytes(payload[4:6], "big")
        expected = {1: (little * 0.5, little), 2: (big * 3 - 7, big)}.get(payload[0] & 3)
        assert row[1] == payload[1]
        assert there[0] == (expected is not None)
        if expected is None:
            assert math.isnan(row[0])
        else:
            assert (row[0], raw[0]) == expected


def test_a_multiplexed_counter_is_refused(tmp_path: Path) -> None:
    """It would be read from the frames of other branches too."""
    dbc = _dbc(tmp_path, MULTIPLEXED.replace("{mark}", " M"))
    with pytest.raises(EchogridError, match="'Turn' of .* is multiplexed, expected a signal that is in every frame"):
        dbc.integer(dbc.message("YawRate", "key"), "Turn", "key")


def test_long_names_are_those_of_the_attributes() -> None:
    text = MOTION + 'BA_ "SystemSignalLongSymbol" SG_ 258 YawRate "AboutTheUpwardAxis";\nBA_ "SystemMessageLongSymbol" BO_ 258 "Turning";\n'
    (message,) = dbc_file.parse(text.encode()).named("Turning")
    assert message.named("AboutTheUpwardAxis")
    assert not message.named("YawRate")


def _opendbc() -> dict[str, bytes]:
    if sys.version_info >= (3, 13):
        pytest.skip("opendbc, whose DBC files this reads, refuses Python 3.13")
    import opendbc

    files = {path.stem: path.read_bytes() for path in Path(opendbc.DBC_PATH).glob("*.dbc")}
    return files | {name: text.encode() for name, text in opendbc.get_generated_dbcs().items()}


def test_all_of_opendbc_is_read_and_what_cannot_be_used_says_why(tmp_path: Path) -> None:
    files = _opendbc()
    assert len(files) == 94
    for data in files.values():
        dbc = _dbc(tmp_path, data)
        for message in dbc.database.messages:
            names = {signal.name for signal in message.signals} | set(message.unread)
            BatchDecoder(message, [name for name in names if not _refusal(dbc, message.name, name)])


@pytest.mark.parametrize("name", ["vw_pq", "ESR", "toyota_adas", "hyundai_kia_mando_corner_radar_generated", "volvo_v40_2017_pt"])
def test_files_of_opendbc_are_decoded_as_by_cantools(tmp_path: Path, name: str) -> None:
    data = _opendbc()[name]
    theirs = ByCantools(strict=False)
    theirs.add_dbc_string(data.decode("cp1252"))
    dbc = _dbc(tmp_path, data)
    random = np.random.default_rng(0)
    compared = 0
    assert {message.name for message in dbc.database.messages} == {message.name for message in theirs.messages}
    for message in dbc.database.messages:
        names = dict.fromkeys(signal.name for signal in message.signals)
        usable = [name for name in names if not _refusal(dbc, message.name, name)]
        payloads = [random.integers(0, 256, message.length, dtype=np.uint8).tobytes() for _ in range(4)]
        by_cantools = theirs.get_message_by_name(message.name)
        for row, payload in zip(BatchDecoder(message, usable).decode(stack(payloads, message.length)), payloads, strict=True):
            try:
                values: Any = by_cantools.decode(payload, decode_choices=False)
            except Exception:  # a multiplexor's value that no signal has, a signal beyond the message's end
                continue
            for signal, value in zip(usable, row, strict=True):
                compared += 1
                assert struct.pack("<d", value) == struct.pack("<d", float(values[signal])) if signal in values else math.isnan(value)
    assert compared > 100


# The same two messages in each format: one plain with a signed Motorola signal, one multiplexed.
SYM = """FormatVersion=6.0 // Do not edit this line!
Title="some"

{SENDRECEIVE}

[Plain]
ID=100h
Len=8
Var=A unsigned 0,12 /f:0.25 /o:-3
Var=B signed 20,11 -m /f:0.5
Var=C float 32,32

[Muxed]
ID=101h
Len=8
Mux=One 0,8 1
Var=D unsigned 8,16
[Muxed]
Len=8
Mux=Two 0,8 2
Var=E signed 8,9 /f:2
"""
KCD = """<NetworkDefinition xmlns="http://kayak.2codeornot2code.org/1.0"><Document name="some"/>
<Bus name="b">
<Message id="0x100" length="8" name="Plain">
<Signal name="A" offset="0" length="12"><Value slope="0.25" intercept="-3"/></Signal>
<Signal name="B" offset="20" length="11" endianess="big"><Value type="signed" slope="0.5"/></Signal>
<Signal name="C" offset="32" length="32"><Value type="single"/></Signal>
</Message>
<Message id="0x101" length="8" name="Muxed">
<Multiplex name="Which" offset="0" length="8">
<MuxGroup count="1"><Signal name="D" offset="8" length="16"/></MuxGroup>
<MuxGroup count="2"><Signal name="E" offset="8" length="9"><Value type="signed" slope="2"/></Signal></MuxGroup>
</Multiplex>
</Message>
</Bus></NetworkDefinition>
"""


@given(st.sampled_from(["sym", "kcd"]), st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=8))
def test_other_formats_are_decoded_as_by_cantools(kind: str, payloads: list[bytes]) -> None:
    text = {"sym": SYM, "kcd": KCD}[kind]
    ours = foreign_database.parse(Path(f"some.{kind}"), text.encode())
    theirs = ByCantools(strict=False)
    {"sym": theirs.add_sym_string, "kcd": theirs.add_kcd_string}[kind](text)
    assert len(ours.messages) == 2
    for message in ours.messages:
        decoder = BatchDecoder(message)
        for row, payload in zip(decoder.decode(stack(payloads, 8)), payloads, strict=True):
            try:
                values: Any = theirs.get_message_by_name(message.name).decode(payload, decode_choices=False)
            except Exception:  # a multiplexor's value that no signal has
                continue
            for name, value in zip(decoder.names, row, strict=True):
                assert value == values[name] or (math.isnan(value) and math.isnan(values[name])) if name in values else math.isnan(value)


@pytest.mark.parametrize("kind", ["sym", "kcd", "arxml"])
def test_a_file_that_cantools_refuses_is_one_sentence(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"some.{kind}"
    for data in (b"\x00\xff nothing", b"<a>\n<b>\n"):
        path.write_bytes(data)
        with pytest.raises(EchogridError, match=rf"some.{kind}: is not a {kind.upper()} file that cantools reads: ") as caught:
            Dbc(path, tmp_path / "profile.toml")
        assert "\n" not in str(caught.value)


def test_a_database_in_another_format_serves_a_profile(tmp_path: Path) -> None:
    """The shipped motion profile over its own messages as cantools writes them in KCD and SYM."""
    by_cantools = ByCantools()
    by_cantools.add_dbc_string(MOTION)
    for kind, text in (("kcd", by_cantools.as_kcd_string()), ("sym", by_cantools.as_sym_string())):
        path = tmp_path / f"motion.{kind}"
        path.write_text(text)
        reader = MotionReader(
            load_motion(DBC / "vehicle_motion.toml"), Dbc(path, DBC / "vehicle_motion.toml"), Motion(bus="can0"), Health()
        )
        assert reader.ids == {(0x100, False), (0x102, False)}


def test_a_database_that_lacks_what_is_needed_says_what(tmp_path: Path) -> None:
    path = tmp_path / "some.kcd"
    path.write_text(KCD)
    with pytest.raises(EchogridError, match=r"wheel_speeds.message: .*some.kcd has no message 'WheelSpeedsRear'"):
        MotionReader(load_motion(DBC / "vehicle_motion.toml"), Dbc(path, DBC / "vehicle_motion.toml"), Motion(bus="can0"), Health())


def test_who_reads_frames_keeps_nothing_of_the_file_but_what_is_read(tmp_path: Path) -> None:
    """A car's own database has thousands of messages, and the service a budget of memory."""
    names = ("vehicle_motion", "corner_radar")
    mine = [Dbc(DBC / f"{name}.dbc", find(name, tmp_path)) for name in names]
    motion, radar = (load(find(name, tmp_path)) for load, name in zip((load_motion, load_radar), names, strict=True))
    readers = (MotionReader(motion, mine[0], Motion(bus="can0"), Health()), RadarReader("front", radar, mine[1], 0, SensorHealth()))
    files = [one.database for one in mine]
    dbc.forget()
    mine.clear()
    gc.collect()
    assert [one for file in files for one in gc.get_referrers(file) if one is not files] == []
    assert all(reader.ids for reader in readers)
