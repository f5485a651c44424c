"""The page in a real browser, where one is at hand: what a person sees and does. Pictures are left in out/view for people to look at."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.pages import served
from tests.support.places import ROOT
from tests.support.playing import playing, published_drive
from tests.support.waiting import until

from echogrid.client import Client
from echogrid.judging.pages import page as judging_page
from echogrid.logs.drive import find_drive
from echogrid.maps.dense_map import write_npz
from echogrid.viewing.doors import Door
from echogrid.viewing.live_feed import LiveFeed
from echogrid.viewing.recorded import DriveFeed
from echogrid.viewing.shows import LiveShow, MapShow, TapeShow
from echogrid.viewing.stored import stored_scene
from echogrid_training.own import page as own_page
from echogrid_training.paper import reproduction_report

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
AXE = os.environ.get("ECHOGRID_AXE")  # axe.min.js of the npm package axe-core
PICTURES = ROOT / "out" / "view"
TOKEN = "correct-horse-battery"
sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is at hand")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A tab whose errors fail the test."""
    errors: list[str] = []
    tab = browser.new_page(viewport={"width": 1280, "height": 800})
    tab.set_default_timeout(120_000)
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    yield tab
    tab.close()
    assert [error for error in errors if "WebSocket connection" not in error] == []  # a server that is away is not the page's fault


@pytest.fixture(scope="module")
def tape(tmp_path_factory: pytest.TempPathFactory) -> DriveFeed:
    folder = published_drive(tmp_path_factory.mktemp("drive"), "tcp/127.0.0.1:1", 9.0, lost_after=5.0)
    feed = DriveFeed(find_drive(folder, None), None)
    feed.run(threading.Event())
    return feed


class Ready(TapeShow):
    """Of a tape that is complete."""

    def work(self, stop: threading.Event) -> None:
        pass


def wait(page: Any, what: str) -> None:
    """Until it is so. (The browser's own waiting would need eval, which the page's policy forbids.)"""
    until(lambda: page.evaluate(f"!!({what})"))


def picture(page: Any, name: str) -> None:
    PICTURES.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=PICTURES / f"{name}.png")


def ink(page: Any) -> list[int]:
    """How many pixels of the picture are white, black and anything else; the page is asked to draw first."""
    return page.evaluate(
        """() => {
            const e = window.echogrid;
            e.dirty = true;
            const count = (done) => {
                const { data } = e.context.getImageData(0, 0, e.canvas.width, e.canvas.height);
                const n = [0, 0, 0];
                for (let i = 0; i < data.length; i += 4) {
                    const [red, , blue, opaque] = data.subarray(i, i + 4);
                    if (opaque) n[red > 240 && blue > 240 ? 0 : red < 40 && blue < 50 ? 1 : 2]++;
                }
                done(n);
            };
            return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => count(done))));
        }"""
    )


def picture_of(page: Any) -> str:
    """All of its pixels."""
    return page.evaluate(
        """() => new Promise((done) => {
            window.echogrid.dirty = true;
            requestAnimationFrame(() => requestAnimationFrame(() => done(window.echogrid.canvas.toDataURL())));
        })"""
    )


def test_a_recording_plays_scrubs_and_shows_what_is_asked_for(page: Any, tape: DriveFeed) -> None:
    with served(Ready(tape)) as (_, port):
        page.goto(f"http://127.0.0.1:{port}/")
        wait(page, "window.echogrid?.timeline.clock?.at > 1")
        first = page.evaluate("echogrid.pose.x")
        wait(page, f"echogrid.pose.x > {first + 2}")  # it moves
        page.keyboard.press(" ")
        wait(page, "!echogrid.timeline.clock.playing")
        assert page.inner_text("#play") == "Play"
        white, black, _ = ink(page)
        assert white > 1000
        assert black > 50
        page.keyboard.press("1")  # without the map
        assert ink(page)[0] < white / 10
        page.keyboard.press("1")
        whole = picture_of(page)
        for layer in "2346":  # detections, fields of view, trail, grid
            page.keyboard.press(layer)
            assert picture_of(page) != whole, layer
            page.keyboard.press(layer)
            assert picture_of(page) == whole, layer
        page.evaluate("echogrid.timeline.seek(2.0)")
        wait(page, "echogrid.timeline.clock.at === 2")
        assert page.inner_text("#state") == "ok"
        assert page.locator("#radars li.bad").count() == 0
        picture(page, "recording")
        page.evaluate("echogrid.timeline.seek(8.5)")
        wait(page, "echogrid.timeline.clock.at > 8")
        wait(page, "document.querySelector('#state').textContent === 'degraded'")
        bad = page.locator("#radars li.bad")
        assert bad.count() == 1
        assert bad.inner_text().startswith("front right")
        assert "silent for" in bad.inner_text()
        assert "radar front_right: silent for" in page.inner_text("#reasons")
        picture(page, "lost-radar")
        for mode in ("source", "age"):
            page.check(f"#modes input[value={mode}]")
            assert page.evaluate("echogrid.map.mode") == mode
            picture(page, mode)
        assert page.is_disabled("#modes input[value=truth]")  # this drive has none
        page.keyboard.press("t")
        picture(page, "dark")


def test_the_ruler_measures_and_hands_move_the_map(page: Any, tape: DriveFeed) -> None:
    with served(Ready(tape)) as (_, port):
        page.goto(f"http://127.0.0.1:{port}/")
        wait(page, "window.echogrid?.pose")
        page.keyboard.press(" ")
        page.evaluate("echogrid.follow = false")  # what is on its way when it pauses would move the map under the ruler
        page.keyboard.press("r")
        page.mouse.move(300, 300)
        page.mouse.down()
        page.mouse.move(300 + 120, 300 + 90)
        page.mouse.up()
        scale = page.evaluate("echogrid.sight.scale")
        assert float(page.inner_text("#pointer").split(" m")[0]) == pytest.approx(150 / scale, abs=0.01)
        picture(page, "ruler")
        page.keyboard.press("Escape")
        before = page.evaluate("echogrid.sight.toWorld(400, 350)")
        top = page.evaluate("echogrid.canvas.getBoundingClientRect().top")
        page.mouse.move(400, 350 + top)
        page.mouse.down()
        page.mouse.move(500, 300 + top)
        page.mouse.up()
        assert page.evaluate("echogrid.sight.toWorld(500, 300)") == pytest.approx(before, abs=1.5 / scale)
        assert not page.evaluate("echogrid.follow")
        page.mouse.wheel(0, -500)
        assert page.evaluate("echogrid.sight.scale") > scale
        assert page.evaluate("echogrid.sight.toWorld(500, 300)") == pytest.approx(before, abs=1.5 / scale)
        page.keyboard.press("0")
        box, seen = page.evaluate("[echogrid.map.bounds(echogrid.cell), echogrid.sight.visible()]")
        assert seen[0] <= box[0] < box[2] <= seen[2]
        page.set_viewport_size({"width": 820, "height": 1180})
        page.keyboard.press("f")
        picture(page, "tablet")


def test_the_pages_numbers_are_the_clients_and_it_comes_back(page: Any, endpoint: str, tmp_path: Path) -> None:
    drive = published_drive(tmp_path / "drive", endpoint, 12.0)
    with playing(drive, tmp_path / "out", 1.0) as run, Client(endpoint, "test") as client:
        with served(LiveShow(LiveFeed(endpoint, "test", None))) as (_, port):
            page.goto(f"http://127.0.0.1:{port}/")
            wait(page, "window.echogrid?.pose")
            window = pose = judged = None
            ended = False
            while not ended:
                ended = run.ended.is_set()  # and once more
                window, pose = client.follow(0.05) or window, client.odometry(0.0) or pose
                judged = client.judged(0.0) or judged
            wait(page, "['stopped', 'silent'].includes(document.querySelector('#state').textContent)")
            assert window is not None
            stamp = page.evaluate("echogrid.pose.stamp")
            assert stamp == pytest.approx(pose.stamp_ns * 1e-9, abs=2e-6)
            assert page.inner_text("#n-place") == f"{pose.x:.1f}, {pose.y:.1f} m"
            assert [int(page.inner_text(f"#c-{name}")) for name in ("static", "moving", "beside")] == [
                int((judged.verdicts == verdict).sum()) for verdict in range(3)
            ]
            by_radar = page.evaluate("[...document.querySelectorAll('#radars .count')].map((count) => Number(count.textContent))")
            assert by_radar == np.bincount(judged.radars, minlength=4).tolist()
            cells = page.evaluate(
                """([x, y, cell, height, width]) => Array.from({length: height * width}, (_, n) =>
                echogrid.map.cellAt(x + (n % width + 0.5) * cell, y + (Math.floor(n / width) + 0.5) * cell, cell).percent)""",
                [*window.origin, window.cell, *window.occupancy.shape],
            )
            assert cells == window.occupancy.ravel().tolist()
            picture(page, "live")
        wait(page, "document.querySelector('#notice').textContent.startsWith('not connected')")  # the server was stopped
        assert "the server was stopped" in page.inner_text("#notice")
        show = LiveShow(LiveFeed(endpoint, "test", None))
        with served(show, Door("127.0.0.1", port, None, None)):
            until(lambda: page.evaluate("document.querySelector('#notice').hidden"))  # and is there again


def test_a_token_is_asked_for_and_leaves_the_address(browser: Any, page: Any, tape: DriveFeed) -> None:
    with served(Ready(tape), Door("127.0.0.1", 0, TOKEN, None)) as (_, port):
        page.goto(f"http://127.0.0.1:{port}/")
        wait(page, "!document.querySelector('#ask').hidden")
        assert page.inner_text("#refused").startswith("the token is missing or wrong")
        page.fill("#token", TOKEN)
        page.click("#ask button")
        wait(page, "window.echogrid?.pose")
        other = browser.new_page()
        other.goto(f"http://127.0.0.1:{port}/#token={TOKEN}")
        wait(other, "window.echogrid?.pose")
        assert other.url == f"http://127.0.0.1:{port}/"
        other.close()


@pytest.mark.skipif(AXE is None, reason="ECHOGRID_AXE does not name the axe.min.js of the npm package axe-core")
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_no_serious_fault(browser: Any, tape: DriveFeed, theme: str) -> None:
    with served(Ready(tape)) as (_, port):
        context = browser.new_context(bypass_csp=True, color_scheme=theme, viewport={"width": 1280, "height": 1400})
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{port}/")
        wait(page, "window.echogrid?.timeline.clock?.at > 6.5")
        page.keyboard.press("?")
        page.add_script_tag(path=AXE)
        violations = page.evaluate(
            "axe.run().then(({violations}) => violations.map(({id, impact, nodes}) => [id, impact, nodes.map((n) => n.html)]))"
        )
        context.close()
    assert [found for found in violations if found[1] in ("serious", "critical")] == []


def test_a_stored_map_can_be_told_by_its_age(page: Any, tmp_path: Path) -> None:
    """Cells that were last seen later than the slider says are not there."""
    older, newer = np.full((64, 64), -5, np.float32), np.full((64, 64), 5, np.float32)
    log_odds, seen_s = np.hstack((older, newer)), np.repeat(np.uint32([[1_700_000_000, 1_700_000_600]]), 64, axis=1).repeat(64, axis=0)
    radars = np.ones(log_odds.shape, np.uint16)
    arrays = {
        "log_odds": log_odds,
        "origin": np.zeros(2),
        "cell": np.float64(0.25),
        "seen_s": seen_s,
        "radars": radars,
        "names": np.array(["one"]),
    }
    write_npz(tmp_path / "map.npz", arrays)
    with served(MapShow(stored_scene(tmp_path / "map.npz", None))) as (_, port):
        page.goto(f"http://127.0.0.1:{port}/")
        wait(page, "window.echogrid?.map.until === Infinity && document.querySelector('#seek').max === '1700000600'")
        assert page.inner_text("#state") == "stored map"
        wait(page, "echogrid.map.bounds(echogrid.cell)")
        until(lambda: min(ink(page)[:2]) > 1000)  # light and dark cells
        page.evaluate("echogrid.timeline.seek(1700000300)")
        assert page.inner_text("#clock") == "seen until 2023-11-14 22:18:20"
        white, black, _ = ink(page)
        assert (white > 1000, black) == (True, 0)
        picture(page, "stored")


def test_no_report_scrolls_sideways(page: Any) -> None:
    """Tables of many columns, and words that cannot be broken: a table is moved, not the page."""
    page.set_viewport_size({"width": 1100, "height": 800})
    wide = [f"column {number} of a table" for number in range(20)], [["f" * 64] * 20]
    tables = {
        own_page.STYLE + own_page.TABLE: own_page.table(*wide),
        reproduction_report.STYLE: reproduction_report._rows(wide[1], wide[0]),
        judging_page.STYLE: f'<div class="finding"><code>{"profile=long/" * 30}</code></div>',
    }
    for style, body in tables.items():
        page.set_content(f"<!doctype html><style>{style}</style><body>{body}")
        assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert "table" not in body or page.evaluate("((it) => it.scrollWidth > it.clientWidth)(document.querySelector('table'))")
