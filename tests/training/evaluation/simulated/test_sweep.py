"""The sweep's drives differ in what is varied and in nothing else, and its curves pool the towns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.support import candidates
from tests.support.tiny_towns import room, town, track

from echogrid_training.evaluation.metrics import iou, overlaps
from echogrid_training.evaluation.simulated import sweep
from echogrid_training.evaluation.simulated.calibrating import Plan, planned, shown
from echogrid_training.evaluation.simulated.maps import ELFES, TUNED
from echogrid_training.evaluation.simulated.sweep import LOST, OTHERS, SEED, Point, curves, episode, points, swept
from echogrid_training.sensors.episode import paper_like


@pytest.fixture(scope="module")
def plan(room_drive: Path) -> Plan:
    with pytest.MonkeyPatch.context() as patch:
        candidates.few(patch)
        return planned([shown(room_drive, [], with_patches=True, with_maps=True)], [])


def test_every_point_is_a_drive_of_its_own() -> None:
    assert len({point.folder for point in points()}) == len(points())
    assert {point.what for point in points()} == {"density", "mounting", "silent radars"}


def test_only_what_is_varied_differs() -> None:
    plain = paper_like(SEED)
    assert episode(Point("density", "8", 0)) == replace(plain, density=8.0)
    for lost in LOST:
        found = episode(Point("silent radars", str(lost), 0))
        assert sum(corner.lost == (0.0, 1.0) for corner in found.corners) == lost
        assert replace(found, corners=plain.corners) == plain
    mountings = [episode(Point("mounting", str(number), 0)) for number in range(2)]
    yaws = [tuple(corner.mount.base_from_sensor.yaw for corner in found.corners) for found in mountings]
    assert yaws[0] != yaws[1]
    assert all(found.density == plain.density and found.radar == plain.radar for found in mountings)


def test_a_drive_is_made_once_and_judged_by_patches_and_maps(plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tiny = town(*room(30.0, 14.0), ego=track(2.5, speed=4.0, x=-7.0))
    monkeypatch.setattr(sweep, "make_town", lambda family, seed, seconds: tiny)
    monkeypatch.setattr(sweep, "PATCHES", 4)
    point, other = Point("silent radars", "2", 0), Point("silent radars", "2", 0, OTHERS)
    first, elsewhere = swept(point, tmp_path, plan), swept(other, tmp_path, plan)
    monkeypatch.setattr(sweep, "simulate", None)  # not again
    second = swept(point, tmp_path, plan)
    assert set(first[1]) == {"patch", "around"}
    assert set(elsewhere[1]) == {"around"}
    found = curves([first, elsewhere, second])["silent radars"]["2"]
    assert found == curves([first, elsewhere])["silent radars"]["2"]  # the same drive twice is the same figures
    assert [set(methods) for methods in found.values()] == [{"Elfes, 15 m"}, *[{ELFES, TUNED}] * 3]
    assert 0 < found["AP"]["Elfes, 15 m"] < 1
    # The other town is the same here: its best threshold is the best there is.
    tally = first[1]["around"][ELFES, 0]
    assert found["IoU of the map"][ELFES] == max(iou(counts) for counts in overlaps(tally.histogram[0]).T)
    assert found["IoU of the map"][ELFES] >= found["IoU at one threshold"][ELFES] - 0.01  # bins are 1/64 wide
