from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import shapely

from echogrid.errors import EchogridError
from echogrid_training.driving.ego_drive import BODY
from echogrid_training.streets.osm_extract import metres, read_extract
from echogrid_training.streets.osm_streets import network_from
from echogrid_training.towns.clearance import ego_corners, swept
from echogrid_training.towns.town import Material, Town, observed_by_car
from echogrid_training.worlds.osm import town_from_osm

LATITUDE, LONGITUDE = 48.0, 11.0
NORTH, EAST = 1 / 111_190.3, 1 / 74_625.1  # degrees per m there, by the series in latitude for WGS 84
SECONDS = 15.0
Points = Sequence[tuple[float, float]]
STREETS: list[Points] = [[(x, y) for x in range(-160, 161, 80)] for y in (-80, 0, 80)] + [
    [(x, y) for y in (-80, 0, 80)] for x in (-80, 0, 80)
]


class Drawing:
    """An .osm file in the making, drawn in m about a place; points that are drawn twice are one node."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[float, float], int] = {}
        self._items: list[str] = []
        self._tagged: dict[tuple[float, float], str] = {}

    def way(self, points: Points, closed: bool = False, **tags: str) -> int:
        ids = [self._node(point) for point in (*points, *(points[:1] if closed else ()))]
        number = 10_000 + len(self._items)
        self._items.append(f'<way id="{number}" version="1">{"".join(f"<nd ref={chr(34)}{i}{chr(34)}/>" for i in ids)}{_tags(tags)}</way>')
        return number

    def point(self, point: tuple[float, float], **tags: str) -> None:
        self._node(point)
        self._tagged[point] = _tags(tags)

    def relation(self, outer: int, inner: int, **tags: str) -> None:
        members = f'<member type="way" ref="{outer}" role="outer"/><member type="way" ref="{inner}" role="inner"/>'
        self._items.append(
            f'<relation id="{30_000 + len(self._items)}" version="1">{members}{_tags({"type": "multipolygon", **tags})}</relation>'
        )

    def _node(self, point: tuple[float, float]) -> int:
        return self._nodes.setdefault(point, len(self._nodes) + 1)

    def write(self, path: Path) -> Path:
        nodes = [
            f'<node id="{number}" version="1" lat="{LATITUDE + place[1] * NORTH:.9f}" lon="{LONGITUDE + place[0] * EAST:.9f}">'
            f"{self._tagged.get(place, '')}</node>"
            for place, number in self._nodes.items()
        ]
        path.write_text(f'<?xml version="1.0"?>\n<osm version="0.6">{"".join((*nodes, *self._items))}</osm>')
        return path


def _tags(tags: dict[str, str]) -> str:
    return "".join(f'<tag k="{key.replace("__", ":")}" v="{value}"/>' for key, value in tags.items())


def rectangle(x: float, y: float, wide: float, deep: float) -> Points:
    return ((x, y), (x + wide, y), (x + wide, y + deep), (x, y + deep))


def village() -> Drawing:
    """Three streets by three with houses in the blocks, and one of each kind of thing."""
    drawing = Drawing()
    for line in STREETS:
        drawing.way(line, highway="residential")
    for x in (-150.0, -70.0, 10.0, 90.0):
        for y in (-72.0, 8.0):
            for house in range(3):
                drawing.way(rectangle(x + 20 * house, y, 14.0, 9.0), closed=True, building="yes", building__levels="3")
                drawing.way(rectangle(x + 20 * house, y + 54, 14.0, 9.0), closed=True, building="house", height="7,5 m")
        drawing.way(((x, -85.0), (x + 50, -85.0)), barrier="hedge")
        drawing.way(((x, 85.0), (x + 50, 85.0)), barrier="wall", height="2")
        drawing.way(((x, -95.0), (x + 50, -95.0)), barrier="fence")
    drawing.point((-40.0, 25.0), natural="tree")
    return drawing


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return village().write(tmp_path_factory.mktemp("osm") / "village.osm")


@pytest.fixture(scope="module")
def town(file: Path) -> Town:
    return town_from_osm(file, 1, SECONDS)


def test_a_seed_gives_a_drive_bit_for_bit_and_another_gives_another(file: Path, town: Town) -> None:
    same, other = town_from_osm(file, 1, SECONDS), town_from_osm(file, 2, SECONDS)
    assert same.ego.x.tobytes() == town.ego.x.tobytes()
    assert [thing.outline.tobytes() for thing in same.things] == [thing.outline.tobytes() for thing in town.things]
    assert other.ego.x.tobytes() != town.ego.x.tobytes()
    assert (town.family, town.name) == ("osm", "village-1")


def test_the_town_is_to_scale_about_the_middle_of_its_houses(file: Path) -> None:
    extract = read_extract(file)
    bounds = np.array(shapely.union_all([area.polygon for area in extract.buildings]).bounds)
    np.testing.assert_allclose(bounds, (-147.0, -71.5, 147.0, 71.5), atol=0.005)  # drawn from -150 to 144 and -72 to 71
    houses = [area.polygon.area for area in extract.buildings]
    np.testing.assert_allclose(houses, 14.0 * 9.0, rtol=1e-3)


def test_streets_meet_at_shared_nodes(file: Path) -> None:
    extract = read_extract(file)
    tree = shapely.STRtree([area.polygon for area in extract.buildings])
    network = network_from(extract.roads, tree, np.random.default_rng(0))
    assert sorted(network.meeting.values()) == [1] * 6 + [3] * 6 + [4] * 3


def test_houses_and_barriers_stand_with_their_heights(file: Path) -> None:
    towns = [town_from_osm(file, seed, SECONDS) for seed in range(6)]  # not every way leads past the wall
    things = [thing for town in towns for thing in town.things]
    assert {thing.top for thing in things if thing.material is Material.BUILDING} == {10.5, 7.5}
    assert {thing.top for thing in things if thing.material is Material.WALL and thing.top == 2.0}
    assert {Material.HEDGE, Material.FENCE, Material.CAR, Material.POLE, Material.KERB} <= {thing.material for thing in things}


def test_the_ego_keeps_clear_of_all_that_stops_it(file: Path) -> None:
    for seed in range(5):
        town = town_from_osm(file, seed, SECONDS)
        shapes = [
            shapely.polygons(thing.outline) if thing.closed else shapely.linestrings(thing.outline)
            for thing in town.things
            if observed_by_car(thing.material)
        ]
        assert shapely.distance(shapely.union_all(shapes), shapely.union_all(swept(ego_corners(town.ego, BODY), 0.1))) >= 0.3


def test_a_court_is_left_open_and_no_outline_hides_it(tmp_path: Path) -> None:
    drawing = village()
    outer = drawing.way(rectangle(-60.0, 20.0, 40.0, 36.0), closed=True)
    inner = drawing.way(rectangle(-50.0, 30.0, 20.0, 16.0), closed=True)
    drawing.relation(outer, inner, building="yes")
    things = [thing for seed in range(6) for thing in town_from_osm(drawing.write(tmp_path / "court.osm"), seed, SECONDS).things]
    outlines = [thing.outline for thing in things if thing.closed and thing.material is Material.BUILDING]
    court = shapely.Point(-37.0, 38.5)
    assert any(len(outline) > 5 for outline in outlines)
    assert not any(shapely.contains(shapely.polygons(outline), court) for outline in outlines)


def test_car_parks_are_filled_in_rows(tmp_path: Path) -> None:
    drawing = village()
    drawing.way(rectangle(-66.0, 20.0, 50.0, 32.0), closed=True, amenity="parking")
    towns = [town_from_osm(drawing.write(tmp_path / "parking.osm"), seed, SECONDS) for seed in range(6)]
    lot = shapely.box(-64.0, 20.0, -12.0, 53.0)
    inside = [sum(shapely.contains(lot, shapely.polygons(t.outline)) for t in town.things if t.material is Material.CAR) for town in towns]
    assert max(inside) > 15


def test_tunnels_arches_and_private_roads_are_not_driven(tmp_path: Path) -> None:
    drawing = village()
    for x, tags in (
        (20.0, {"tunnel": "yes"}),
        (30.0, {"access": "private"}),
        (40.0, {"layer": "1"}),
        (15.0, {}),
    ):  # the last: through houses
        drawing.way(((x, -80.0), (x, 0.0)), highway="service", **tags)
    extract = read_extract(drawing.write(tmp_path / "shut.osm"))
    network = network_from(extract.roads, shapely.STRtree([area.polygon for area in extract.buildings]), np.random.default_rng(0))
    assert len(network.streets) == 18


def test_one_way_streets_are_driven_one_way(tmp_path: Path) -> None:
    drawing = Drawing()
    drawing.way(((0.0, 0.0), (50.0, 0.0)), highway="residential", oneway="-1")
    drawing.way(rectangle(0.0, 20.0, 10.0, 10.0), closed=True, building="yes")
    extract = read_extract(drawing.write(tmp_path / "one.osm"))
    network = network_from(extract.roads, shapely.STRtree([area.polygon for area in extract.buildings]), np.random.default_rng(0))
    (street,) = network.streets
    assert street.one_way
    assert street.line[0, 0] > street.line[-1, 0]
    assert len(network.leaving) == 1


@pytest.mark.parametrize(("text", "value"), [("3.5", 3.5), ("3,5 m", 3.5), ("12'", 3.6576), ("two", None), (None, None)])
def test_lengths_as_people_tag_them(text: str | None, value: float | None) -> None:
    assert metres(text) == pytest.approx(value)


def sentence(path: Path) -> str:
    with pytest.raises(EchogridError) as caught:
        town_from_osm(path, 0, SECONDS)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_a_file_without_buildings_is_one_sentence(tmp_path: Path) -> None:
    drawing = Drawing()
    drawing.way(((0.0, 0.0), (300.0, 0.0)), highway="residential")
    assert "holds no building" in sentence(drawing.write(tmp_path / "field.osm"))


def test_a_torn_file_is_one_sentence(file: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.osm"
    torn.write_bytes(file.read_bytes()[:-400])
    assert "torn" in sentence(torn)


@pytest.mark.parametrize("name", ["notes.txt", "notes.osm", "notes.osm.pbf"])
def test_another_file_is_one_sentence(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("This is no map. " * 20)
    assert "is no OpenStreetMap extract" in sentence(path)


def test_no_file_is_one_sentence(tmp_path: Path) -> None:
    assert "there is no such file" in sentence(tmp_path / "nowhere.osm")


def test_no_road_long_enough_is_one_sentence(tmp_path: Path) -> None:
    drawing = Drawing()
    drawing.way(((0.0, 0.0), (30.0, 0.0)), highway="residential")
    drawing.way(rectangle(0.0, 20.0, 10.0, 10.0), closed=True, building="yes")
    assert "has no way among its buildings" in sentence(drawing.write(tmp_path / "short.osm"))
