import numpy as np
import pytest
import shapely

from echogrid_training.driving.ego_drive import BODY
from echogrid_training.streets.style import FAMILIES
from echogrid_training.towns.clearance import corners, ego_corners, mover_corners, overlapping, swept
from echogrid_training.towns.town import Material, Mover, Town, Track, observed_by_car
from echogrid_training.worlds.layout import make_town

SECONDS = 30.0


@pytest.fixture(scope="module")
def towns() -> list[Town]:
    return [make_town(family, seed, SECONDS) for family in FAMILIES for seed in range(2)]


def at(mover: Mover, times: np.ndarray) -> Mover:
    track = mover.track
    values = (np.interp(times, track.time, getattr(track, name)) for name in ("x", "y", "yaw", "speed", "yaw_rate"))
    return Mover(mover.material, mover.length, mover.width, mover.height, Track(times, *values))


def test_no_mover_ever_overlaps_the_ego_or_another(towns: list[Town]) -> None:
    for town in towns:
        boxes = [ego_corners(town.ego, BODY), *(mover_corners(at(mover, town.ego.time)) for mover in town.movers)]
        for index, one in enumerate(boxes):
            assert not any(overlapping(one, other).any() for other in boxes[:index])


def test_no_mover_passes_through_what_stands(towns: list[Town]) -> None:
    for town in towns:
        standing = [thing.outline for thing in town.things if thing.closed and thing.bottom < 2.0 and observed_by_car(thing.material)]
        tree = shapely.STRtree([shapely.polygons(outline) for outline in standing])
        for mover in town.movers:
            assert not tree.query(swept(mover_corners(mover)), predicate="intersects").size


def test_tracks_last_as_long_as_the_drive_and_agree_with_their_speeds(towns: list[Town]) -> None:
    for town in towns:
        for mover in town.movers:
            track = mover.track
            assert track.time[0] == 0.0
            assert track.time[-1] == pytest.approx(town.ego.time[-1])
            step = np.diff(track.time)
            moved = np.hypot(np.diff(track.x), np.diff(track.y)) / step
            np.testing.assert_allclose(moved, np.abs(track.speed[1:] + track.speed[:-1]) / 2, atol=0.06)
            bound = {Material.PEDESTRIAN: 2.0, Material.CYCLIST: 7.0, Material.CAR: 16.0}[mover.material]
            assert np.abs(track.speed).max() < bound


def test_there_is_traffic_of_all_kinds(towns: list[Town]) -> None:
    kinds = [mover.material for town in towns for mover in town.movers]
    assert set(kinds) == {Material.CAR, Material.CYCLIST, Material.PEDESTRIAN}
    assert len(kinds) > 3 * len(towns)


def test_overlap_of_boxes_is_that_of_polygons() -> None:
    rng = np.random.default_rng(1)
    poses = rng.uniform(-3, 3, (2, 3, 500))
    one, other = (corners(x, y, yaw, 2.0, 1.0, 1.5) for x, y, yaw in poses)
    expected = shapely.intersects(shapely.polygons(one), shapely.polygons(other))
    np.testing.assert_array_equal(overlapping(one, other), expected)
