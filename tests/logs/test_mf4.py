"""MF4, which asammdf reads: what python-can writes comes back, and what is torn or foreign is one sentence."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.logs.test_readers import START, frames, key
from tests.support import recorded
from tests.support.places import DEMO
from tests.support.waiting import PATIENCE

from echogrid.errors import EchogridError
from echogrid.logs.log import Log

asammdf = pytest.importorskip("asammdf", reason="asammdf is installed for tests on x86-64 with Python 3.11 alone (requirements/develop.in)")
pytestmark = [
    pytest.mark.hypothesis,
    pytest.mark.filterwarnings("default"),  # it uses what pandas and numpy will drop
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),  # and leaves temporary files open
]


@pytest.fixture(autouse=True)
def _its_files() -> Iterator[None]:
    yield
    gc.collect()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("mf4")


def written(path: Path, messages: list[can.Message]) -> Path:
    """By python-can, whose channels are numbers: those that a logger would give, from 1."""
    path.unlink(missing_ok=True)
    for message in messages:
        message.channel = recorded.number(message)
    return recorded.by_python_can(path, messages)


@given(frames())
@settings(max_examples=8, deadline=None)
def test_what_python_can_writes_reads_back(folder: Path, messages: list[can.Message]) -> None:
    """But for the flags of remote frames, which have none there; frames of one kind keep their order."""
    messages[0].is_remote_frame, messages[0].data = False, bytearray(messages[0].dlc)
    log = Log(written(folder / "a.mf4", messages))
    found = list(log)
    kinds = [[message for message in some if message.is_remote_frame is asks] for some in (messages, found) for asks in (False, True)]
    for ours, theirs in ((kinds[2], kinds[0]), (kinds[3], kinds[1])):
        assert [key(message) for message in ours] == [key(message) for message in theirs]
        assert np.allclose([m.timestamp for m in ours], [m.timestamp for m in theirs], rtol=0, atol=1e-6)
    assert log.account.remote == len(kinds[3])


def test_signals_in_place_of_frames_are_named(folder: Path) -> None:
    """What tools of measurement write: the bus's frames were decoded, and are gone."""
    path, stamps = folder / "signals.mf4", np.arange(0.0, 1.0, 0.1)
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(stamps, stamps, name=name) for name in ("WheelSpeed", "YawRate")])
        file.save(path, overwrite=True)
    with pytest.raises(EchogridError, match=r"it holds signals such as WheelSpeed, YawRate, expected the bus's frames"):
        list(Log(path))


def test_a_group_that_does_not_say_how_long_its_ids_are(folder: Path) -> None:
    """Without CAN_DataFrame.IDE small ids have 11 bits."""
    mdf = asammdf.MDF(version="4.10")
    n, lengths = 4, np.full(4, 8, np.uint8)
    parts = {
        "BusChannel": np.ones(n, np.uint8),
        "ID": np.array([0x100, 0x7FF, 0x800, 0x18FF0001], np.uint32),
        "Dir": np.zeros(n, np.uint8),
        "DLC": lengths,
        "DataLength": lengths,
        "DataBytes": np.arange(n * 8, dtype=np.uint8).reshape(n, 8),
    }
    record = np.rec.fromarrays(list(parts.values()), dtype=[(f"CAN_DataFrame.{name}", a.dtype, a.shape[1:]) for name, a in parts.items()])
    source = asammdf.Source("a", "a", "", asammdf.blocks.v4_constants.SOURCE_BUS, asammdf.blocks.v4_constants.BUS_TYPE_CAN)
    signal = asammdf.Signal(record, np.arange(n) / 10, name="CAN_DataFrame", source=source)
    mdf.append([signal], acq_name="a", acq_source=source)
    mdf.save(folder / "noide.mf4", overwrite=True)
    mdf.close()
    found = list(Log(folder / "noide.mf4"))
    assert [(m.arbitration_id, m.is_extended_id) for m in found] == [(0x100, False), (0x7FF, False), (0x800, True), (0x18FF0001, True)]
    assert {m.channel for m in found} == {1}


@given(share=st.floats(0, 0.999))
@settings(max_examples=20, deadline=None)
def test_a_torn_file_is_one_sentence(folder: Path, share: float) -> None:
    """Its index is at the end, so without that nothing can be read, and nothing is said to be all."""
    whole = folder / "whole.mf4"
    if not whole.exists():
        messages = [can.Message(timestamp=START + n / 100, channel=f"can{n % 2}", data=bytes([n] * 8)) for n in range(120)]
        written(whole, messages)
    data = whole.read_bytes()
    (folder / "torn.mf4").write_bytes(data[: round(share * len(data))])
    with pytest.raises(EchogridError, match="torn.mf4: (cannot be read beyond message|holds no CAN message)") as caught:
        list(Log(folder / "torn.mf4"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (b"mdfr\0\0\0\0", "its head names 'mdfr' as the program that wrote it"),
        (b"MDF4 Lib", "its head names 'MDF4Lib' as the program that wrote it"),
        (b"\0\n\xff\x80    ", "its head names no program that wrote it"),
    ],
)
def test_of_a_file_that_cannot_be_read_the_program_that_wrote_it_is_named(
    folder: Path, name: bytes, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    """Where asammdf opens it, where it does not, and where it stumbles on the way; once, and nothing but that."""
    log = [can.Message(timestamp=START, arbitration_id=0x100, is_extended_id=False, data=b"1", channel="can0")]
    frames = written(folder / "frames.mf4", log).read_bytes()
    with asammdf.MDF() as file:
        file.append([asammdf.Signal(np.arange(3.0), np.arange(3.0), name="YawRate")])
        file.save(folder / "signals.mf4", overwrite=True)
    signals, path = (folder / "signals.mf4").read_bytes(), folder / "other.mf4"
    for data in (frames[: len(frames) // 2], frames.replace(b"##DG", b"##GD"), signals):
        path.write_bytes(data[:16] + name + data[24:])
        with pytest.raises(EchogridError) as caught:
            list(Log(path))
        assert str(caught.value).endswith(f"; {said}")
        assert "\n" not in str(caught.value)
    assert caplog.records == []


def test_the_program_loads_it_for_mf4_alone(folder: Path) -> None:
    """It takes a second and 86 MiB, and python-can imports it wherever it is installed."""
    message = can.Message(timestamp=START, arbitration_id=0x7FF, is_extended_id=False, data=b"1", channel="can0")
    path = written(folder / "program.mf4", [message])
    code = "import sys; from echogrid.cli import main\ntry: main()\nexcept SystemExit: pass\nprint('pandas' in sys.modules)"
    for name, loaded in ((folder / "none.log", False), (path, True)):
        command = [sys.executable, "-c", code, "replay", name, "-c", DEMO / "echogrid.toml", "--out", folder / "out"]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE)
        assert done.stdout.split()[-1] == str(loaded), done.stderr
    assert "none of its 1 frames is one that" in done.stderr
