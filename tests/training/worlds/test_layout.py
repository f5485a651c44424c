import itertools
from dataclasses import fields

import numpy as np
import pytest
import shapely

from echogrid.errors import EchogridError
from echogrid_training.driving.ego_drive import BODY
from echogrid_training.streets.style import FAMILIES, LIKE_ALL, Family
from echogrid_training.towns.clearance import ego_corners, swept
from echogrid_training.towns.town import Material, Thing, Town, observed_by_car
from echogrid_training.worlds.layout import make_town

SECONDS = 20.0


def shape(thing: Thing) -> shapely.Geometry:
    return shapely.polygons(thing.outline) if thing.closed else shapely.linestrings(thing.outline)


def gap(town: Town) -> float:
    """From the ego's outline, wherever it goes, to the nearest thing that stops a car; m."""
    standing = [shape(thing) for thing in town.things if observed_by_car(thing.material)]
    return float(shapely.distance(shapely.union_all(standing), shapely.union_all(swept(ego_corners(town.ego, BODY), step=0.1))))


@pytest.mark.parametrize("family", FAMILIES)
def test_the_same_seed_is_the_same_town_bit_for_bit_and_another_is_another(family: str) -> None:
    one, same, other = (make_town(family, seed, SECONDS) for seed in (7, 7, 8))
    assert [thing.outline.tobytes() for thing in one.things] == [thing.outline.tobytes() for thing in same.things]
    assert [(thing.material, thing.bottom, thing.top) for thing in one.things] == [(t.material, t.bottom, t.top) for t in same.things]
    assert [mover.track.x.tobytes() for mover in one.movers] == [mover.track.x.tobytes() for mover in same.movers]
    assert one.ego.yaw.tobytes() == same.ego.yaw.tobytes()
    assert one.ego.yaw.tobytes() != other.ego.yaw.tobytes()


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_that_stops_a_car_is_in_the_egos_way(family: str) -> None:
    for seed in range(20, 25):
        assert gap(make_town(family, seed, SECONDS)) >= 0.3, seed


@pytest.mark.parametrize("field", [field.name for field in fields(Family) if field.name not in LIKE_ALL])
def test_no_habit_of_one_family_is_one_of_anothers(field: str) -> None:
    ranges = sorted(getattr(family, field) for family in FAMILIES.values())
    assert all(low < high for low, high in ranges)
    assert all(before[1] < after[0] for before, after in itertools.pairwise(ranges))


def test_layouts_are_of_one_family_only_and_colonnades_are_held_out_for_test() -> None:
    for one, other in itertools.combinations(FAMILIES.values(), 2):
        assert not set(one.layouts) & set(other.layouts)
    assert [name for name, family in FAMILIES.items() if "colonnade" in dict(family.lots)] == ["test"]


def test_things_are_well_formed_and_close_to_the_way() -> None:
    town = make_town("train", 3, SECONDS)
    way = shapely.linestrings(np.stack((town.ego.x, town.ego.y), axis=-1))
    for thing in town.things:
        assert len(thing.outline) >= (3 if thing.closed else 2)
        assert np.isfinite(thing.outline).all()
        assert 0.0 <= thing.bottom < thing.top
        assert shapely.distance(way, shape(thing)) < 46.0
        if thing.closed:
            assert shapely.is_ccw(shapely.linearrings(thing.outline))
        if thing.material is Material.OVERHEAD:
            assert thing.bottom > 1.7  # above a car's roof
    assert {Material.BUILDING, Material.CAR, Material.POLE, Material.KERB} <= {thing.material for thing in town.things}


def test_open_places_have_room_and_small_things_and_few_walls() -> None:
    """Beside streets of the train family: more ground within 15 m of the way, fewer surfaces of houses, walls and cars, more on foot."""

    def figures(family: str) -> tuple[float, float, int, int]:
        ground, surface, small, plates = [], [], 0, 0
        for seed in range(4):
            town = make_town(family, seed, SECONDS)
            near = shapely.buffer(shapely.linestrings(np.stack((town.ego.x, town.ego.y), axis=-1)), 15.0)
            roads = shapely.union_all([shapely.buffer(shapely.linestrings(road.line), road.width / 2) for road in town.roads])
            ground.append(shapely.area(shapely.intersection(roads, near)) / shapely.area(near))
            bounding = (Material.BUILDING, Material.WALL, Material.CAR, Material.FENCE)
            sides = np.concatenate([thing.segments() for thing in town.things if thing.material in bounding])
            surface.append(sum(shapely.length(shapely.intersection(shapely.linestrings(sides), near))) / shapely.area(near))
            small += sum(t.material in (Material.CONE, Material.BARRIER, Material.BICYCLE, Material.PEDESTRIAN) for t in town.things)
            plates += sum(t.material is Material.PLATE for t in town.things)
        return float(np.mean(ground)), float(np.mean(surface)), small, plates

    open_, train, test = figures("open"), figures("train"), figures("test")
    assert open_[0] > 1.3 * train[0]
    assert open_[1] < 0.5 * train[1]
    assert open_[2] > train[2] > test[2] == 0
    assert min(open_[3], train[3]) > test[3] == 0


def test_iron_in_the_ground_is_driven_over() -> None:
    assert not observed_by_car(Material.PLATE)
    assert all(thing.top < 0.3 for thing in make_town("open", 2, SECONDS).things if thing.material is Material.PLATE)


@pytest.mark.parametrize("family", ["train", "calibration", "test"])
def test_a_few_percent_of_the_cells_about_the_ego_are_surfaces(family: str) -> None:
    shares = []
    for seed in range(3):
        town = make_town(family, seed, SECONDS)
        points = []
        for start, end in np.concatenate([thing.segments() for thing in town.things if observed_by_car(thing.material)]):
            points.append(start + (end - start) * np.linspace(0, 1, max(2, int(10 * np.hypot(*(end - start)))))[:, None])
        for x, y in zip(town.ego.x[::500], town.ego.y[::500], strict=True):
            near = np.concatenate(points) - (x, y)
            cells = np.unique(np.floor(near[(np.abs(near) < 15.0).all(axis=1)] / 0.2), axis=0)
            shares.append(len(cells) / 150**2)
    assert 0.02 < np.median(shares) < 0.06


def test_a_family_that_there_is_not_is_one_sentence() -> None:
    with pytest.raises(EchogridError, match="there is no family of towns 'village', only train, calibration, test, open"):
        make_town("village", 0, SECONDS)
