"""A running service on the page: the same numbers as `echogrid.client` has, across restarts of either end."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
from tests.support.pages import Seen, served, watch
from tests.support.playing import playing, published_drive
from tests.support.waiting import until
from websockets.sync.client import ClientConnection

from echogrid.client import Client
from echogrid.viewing.live_feed import LiveFeed
from echogrid.viewing.shows import LiveShow
from echogrid.viewing.wire import Kind, Plane


def hear(viewer: ClientConnection, seen: Seen, enough: threading.Event) -> None:
    while not enough.is_set():
        try:
            seen.take(viewer.recv(timeout=0.1))
        except TimeoutError:
            continue


def test_viewers_know_what_the_client_knows_early_and_late(endpoint: str, tmp_path: Path) -> None:
    drive = published_drive(tmp_path / "drive", endpoint, 8.0, lost_after=4.0)
    show = LiveShow(LiveFeed(endpoint, "test", None))
    early, late, enough = Seen(), Seen(), threading.Event()
    with served(show) as (_, port), watch(port) as first:
        listening = threading.Thread(target=hear, args=(first, early, enough))
        listening.start()
        bad: set[str] = set()
        with playing(drive, tmp_path / "out", 1.0) as run, Client(endpoint, "test") as client:
            window = pose = judged = meta = None
            while not run.ended.is_set():
                window, pose = client.follow(0.02) or window, client.odometry(0.0) or pose
                judged, meta = client.judged(0.0) or judged, client.meta(0.0) or meta
                if (status := early.documents.get(Kind.STATUS)) is not None:
                    bad |= {part["name"] for part in status["parts"] if part["level"] == 1 and part["said"].startswith("silent for")}
        assert window is not None
        until(lambda: early.documents.get(Kind.STATUS, {}).get("state") == "stopped")
        with watch(port) as second:
            while not {Kind.STATUS, Kind.POSE, Kind.POINTS} <= set(late.kinds):
                late.take(second.recv(timeout=60))
            # One that goes and one that comes later see the service come back, and its new map in place of the old one.
            with playing(drive, tmp_path / "again", 1.0) as run:
                run.ended.wait(120)
            until(lambda: early.kinds.count(Kind.RESET) > 1)
        until(lambda: early.documents[Kind.STATUS]["state"] == "silent")
        enough.set()
        listening.join()
    assert "radar front_right" in bad
    cell = window.cell
    where = (round(window.origin[1] / cell), round(window.origin[0] / cell), *window.occupancy.shape, -1)
    np.testing.assert_array_equal(late.cells(Plane.OCCUPANCY, *where), window.occupancy)
    assert late.pose == (pose.stamp_ns, pose.x, pose.y, pose.yaw, pose.speed, pose.yaw_rate)
    assert late.documents[Kind.HELLO]["radars"] == meta["radars"]
    stamp_ns, places, radars, verdicts = late.points
    assert stamp_ns == judged.stamp_ns
    assert (radars.tolist(), verdicts.tolist()) == (judged.radars.tolist(), judged.verdicts.tolist())
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    np.testing.assert_allclose(places, judged.points[:, :2] @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y), atol=1e-3)


def test_a_service_that_is_not_there_is_waited_for_and_said_so(endpoint: str) -> None:
    with served(LiveShow(LiveFeed(endpoint, "car", None))) as (_, port), watch(port) as viewer:
        seen = Seen()
        while Kind.STATUS not in seen.kinds:
            seen.take(viewer.recv(timeout=60))
    status = seen.documents[Kind.STATUS]
    assert status["state"] == "silent"
    assert status["reasons"][0].endswith(f"waiting for car at {endpoint}")
