"""The page in another make of browser, where one is at hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.firefox import FIREFOX, firefox
from tests.support.pages import served
from tests.support.places import ROOT
from tests.support.playing import published_drive

from echogrid.logs.drive import find_drive
from echogrid.viewing.recorded import DriveFeed
from echogrid.viewing.shows import TapeShow


@pytest.mark.skipif(FIREFOX is None, reason="no Firefox is at hand")
def test_a_recording_plays_and_scrubs_in_firefox_too(tmp_path: Path) -> None:
    feed = DriveFeed(find_drive(published_drive(tmp_path / "drive", "tcp/127.0.0.1:1", 9.0, lost_after=5.0), None), None)
    with served(TapeShow(feed)) as (_, port), firefox(tmp_path / "profile") as tab:
        tab.goto(f"http://127.0.0.1:{port}/")
        tab.wait("window.echogrid?.timeline.clock?.at > 1")
        first = tab.evaluate("echogrid.pose.x")
        tab.wait(f"echogrid.pose.x > {first + 2}")
        tab.press(" ")
        tab.wait("!echogrid.timeline.clock.playing")
        tab.wait("echogrid.timeline.clock.done >= 1")
        tab.evaluate("void echogrid.timeline.seek(8.5)")
        tab.wait("echogrid.timeline.clock.at > 8")
        tab.wait("document.querySelector('#state').textContent === 'degraded'")
        assert "silent for" in tab.evaluate("document.querySelector('#radars li.bad').textContent")
        tab.press("m")
        assert tab.evaluate("echogrid.map.mode") == "source"
        tab.press("m")
        tab.press("m")
        tab.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        tab.picture(ROOT / "out" / "view" / "firefox.png")
        colours = (
            "new Set(new Uint32Array(echogrid.context.getImageData(0, 0, echogrid.canvas.width, echogrid.canvas.height).data.buffer)).size"
        )
        assert tab.evaluate(colours) > 20
        assert tab.errors == []
