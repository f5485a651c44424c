"""Detections that a DBC numbers through pages of a multiplexor: as those of the plain DBC, or a sentence, or an incomplete scan."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from tests.can.test_radar import feed, reader
from tests.support.frames import Detection, radar_cycle
from tests.support.paged import paged_dbc
from tests.support.places import DBC

from echogrid.can import decode, quantity
from echogrid.can.dbc import Dbc
from echogrid.can.profile import load_radar
from echogrid.can.radar import RadarReader
from echogrid.core.health import SensorHealth
from echogrid.core.kernels import dispatch, reference
from echogrid.core.radar import scan as assembling
from echogrid.errors import EchogridError

MANY: list[Detection] = [(3.0 + 0.7 * i, -1.2 + 0.03 * i, -9.5 + 0.2 * i) for i in range(64)]


@pytest.fixture(params=[dispatch.loops, reference], ids=["compiled", "numpy"])
def loops(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Both ways, where there are two."""
    with (
        mock.patch.object(decode, "loops", request.param),
        mock.patch.object(quantity, "loops", request.param),
        mock.patch.object(assembling, "loops", request.param),
    ):
        yield request.param


def paged(folder: Path, pages: int, change: tuple[str, str] = ("", "")) -> RadarReader:
    """Our radar by a DBC that has so many pages."""
    (folder / "paged.dbc").write_text(paged_dbc(pages))
    text = (DBC / "corner_radar.toml").read_text().replace("per_frame = 8", f"per_frame = {8 * pages}")
    path = folder / "paged.toml"
    path.write_text(text.replace("corner_radar.dbc", "paged.dbc").replace(*change))
    return RadarReader("radar", load_radar(path), Dbc(folder / "paged.dbc", path), 0, SensorHealth())


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("change", [("", ""), ('page = "Page"\n', "")], ids=["by page", "in their order"])
def test_pages_of_a_multiplexor_say_what_the_plain_dbc_says(tmp_path: Path, change: tuple[str, str]) -> None:
    radar, (plain, _) = paged(tmp_path, 8, change), reader("corner_radar")
    for cycle, count in enumerate((0, 1, 8, 9, 30, 64)):
        messages = radar_cycle(MANY[:count], cycle, 1.0 + cycle)
        ((one,), (other,)) = feed(radar, messages), feed(plain, messages)
        for name in ("range", "azimuth", "range_rate", "rcs"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert (one.stamp_ns, len(one)) == (other.stamp_ns, count)
    assert radar.health == SensorHealth()
    assert feed(radar, radar_cycle(MANY[:30], 9, 9.0)[:-1]) + feed(radar, radar_cycle(MANY[:30], 10, 9.05))[1:] == []
    assert radar.health.incomplete == 1, "a page that is lost"


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("pages", [1, 2, 5])
def test_detections_that_the_header_counts_and_no_page_has_are_an_incomplete_scan(tmp_path: Path, pages: int) -> None:
    radar, sound = paged(tmp_path, pages), 8 * pages
    assert [len(scan) for scan in feed(radar, radar_cycle(MANY[:sound], 1, 1.0))] == [sound]
    for cycle, count in enumerate((sound + 1, 64), 2):
        assert feed(radar, radar_cycle(MANY[:count], cycle, float(cycle))) == []
    assert radar.health == SensorHealth(incomplete=2)


@pytest.mark.usefixtures("loops")
def test_a_header_that_counts_more_than_the_frames_that_there_ever_are(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text("frames = 2\n" + (DBC / "corner_radar.toml").read_text().replace("corner_radar.dbc", str(DBC / "corner_radar.dbc")))
    radar = RadarReader("radar", load_radar(path), Dbc(DBC / "corner_radar.dbc", path), 0, SensorHealth())
    cycles = [radar_cycle(MANY[:count], cycle, 1.0 + cycle / 20) for cycle, count in enumerate((16, 30, 9, 17, 16))]
    cycles[1], cycles[3] = cycles[1][:3], cycles[3][:3]
    assert [len(scan) for messages in cycles for scan in feed(radar, messages)] == [16, 9, 16]
    assert radar.health == SensorHealth(incomplete=2)


BRANCHED = """BU_: R E

BO_ 1 Head: 1 R
 SG_ Count : 0|8@1+ (1,0) [0|255] "" E

BO_ 2 Points: 8 R
 SG_ Page M : 0|4@1+ (1,0) [0|15] "" E
"""
PROFILE = """kind = "radar"
[header]
message = "Head"
count = ["Count"]
[detections]
messages = "Points"
per_frame = {each}
range = {{ signal = "R{{k}}", unit = "m" }}
azimuth = {{ signal = "A{{k}}", unit = "rad" }}
range_rate = {{ signal = "V{{k}}", unit = "m/s" }}
"""


@pytest.mark.parametrize(
    ("branches", "complaint"),
    [
        ([("m0",) * 3, ("m1",) * 3, ("m1",) * 3], "has its detections in frames of 1 and of 2, expected as many in each"),
        ([("m0",) * 3, ("m1",) * 3, ("m0",) * 3], "has its detections in frames that overlap"),
        ([("m0",) * 3, ("",) * 3, ("m1",) * 3], "has its detections in frames that overlap"),
        ([("m0", "m1", "m0")], "R1, A1, V1 found, which are never in one frame"),
        ([("m0",) * 3, ("m0",) * 3, ("m1",) * 3], None),  # the last page may be shorter
        ([("m0",) * 3, ("",) * 3], None),  # of which a frame may have both
    ],
)
def test_pages_of_which_none_can_say_how_many_there_are(
    tmp_path: Path, branches: list[tuple[str, str, str]], complaint: str | None
) -> None:
    lines = [
        f' SG_ {"RAV"[n]}{k} {by} : {8 + 8 * n}|8@1+ (1,0) [0|0] "" E' for k, one in enumerate(branches, 1) for n, by in enumerate(one)
    ]
    dbc, path = tmp_path / "branched.dbc", tmp_path / "branched.toml"
    dbc.write_text(BRANCHED + "\n".join(lines) + "\n")
    path.write_text(PROFILE.format(each=len(branches)))
    if complaint is None:
        RadarReader("radar", load_radar(path), Dbc(dbc, path), 0, SensorHealth())
        return
    with pytest.raises(EchogridError) as caught:
        RadarReader("radar", load_radar(path), Dbc(dbc, path), 0, SensorHealth())
    assert str(caught.value).startswith(f"{path}: detections: {dbc}: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
