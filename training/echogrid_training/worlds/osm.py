"""Real towns: an OpenStreetMap extract, a drive along its roads, and what the map leaves out: parked cars, posts, traffic."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.driving.ego_drive import BODY, drive
from echogrid_training.driving.traffic import traffic
from echogrid_training.streets.osm_extract import Area, Extract, Tags, Way, metres, read_extract
from echogrid_training.streets.osm_streets import network_from
from echogrid_training.streets.shapes import along, disc, frame_at, length
from echogrid_training.streets.style import FAMILIES, Style, draw
from echogrid_training.towns.carriageway import carriageways
from echogrid_training.towns.clearance import ROOM, ego_corners, in_the_way, swept
from echogrid_training.towns.furniture import along_street, kerbs
from echogrid_training.towns.lots import tree
from echogrid_training.towns.parking import beside, parked
from echogrid_training.towns.piece import Piece, cut, merged, solid, things, within, without_holes
from echogrid_training.towns.town import Material, Road, Town, Track
from echogrid_training.worlds.layout import corridor

STOREY = 3.0  # m
# Material and height in m of barriers; whatever else is mapped as one (kerbs, gates, steps) does not stop a car for long.
BARRIERS = {
    "wall": (Material.WALL, 1.8),
    "city_wall": (Material.WALL, 5.0),
    "retaining_wall": (Material.WALL, 1.5),
    "fence": (Material.FENCE, 1.5),
    "handrail": (Material.FENCE, 1.0),
    "hedge": (Material.HEDGE, 1.4),
    "guard_rail": (Material.GUARD_RAIL, 0.75),
    "jersey_barrier": (Material.WALL, 0.9),
}


def town_from_osm(path: Path | str, seed: int, seconds: float) -> Town:
    """A drive of so many seconds somewhere in an extract; the same file and seed give the same bits. Raises EchogridError."""
    path = Path(path)
    extract = read_extract(path)
    rng = np.random.default_rng(np.random.SeedSequence((len(FAMILIES), seed)))
    style = draw(FAMILIES["train"], rng)  # for what no map holds: how people park, and posts and trees where none are mapped
    houses = [piece for area in extract.buildings for piece in _house(area, rng)]
    tree_of = shapely.STRtree([piece.shape for piece in houses if piece.material is Material.BUILDING])
    network = network_from(extract.roads, tree_of, rng)

    def possible(ego: Track) -> bool:
        """Among houses and clear of them."""
        seen = shapely.points(ego.x[::200], ego.y[::200])
        among = np.unique(tree_of.query(seen, predicate="dwithin", distance=30.0)[0])
        return len(among) > 0.7 * len(seen) and not tree_of.query(swept(ego_corners(ego, BODY)), predicate="dwithin", distance=ROOM).size

    way = drive(network, seconds, rng, possible)
    if way is None:
        raise EchogridError(f"{path}: has no way among its buildings on which one could drive for {seconds:g} s")
    area = corridor(way)
    near = [street for street in network.streets if shapely.intersects(area, shapely.linestrings(street.line))]
    ground = carriageways(network, near)
    mapped = _mapped(extract, rng)
    cars = [car for street in near for car in beside(network, street, style, rng)]
    cars += [car for lot in extract.parking if shapely.intersects(area, lot.polygon) for car in _lot(lot, style, rng)]
    extra = [piece for street in near for piece in along_street(network, street, style, rng)]
    above = [piece for piece in (*houses, *mapped, *extra) if piece.material is Material.OVERHEAD]
    houses, mapped, extra = (_grounded(pieces, area) for pieces in (houses, mapped, extra))
    pieces = merged([*houses, *cut(mapped, ground), *_grounded(cars, area), *cut(extra, ground)])
    standing = [
        *_cleared(pieces, way.ego),
        *(piece for piece in above if shapely.intersects(area, piece.shape)),
        *within(kerbs(ground), area),
    ]
    made = tuple(things(standing))
    roads = tuple(Road(street.line, street.width) for street in near)
    return Town(f"{path.name.split('.')[0]}-{seed}", "osm", seed, made, roads, traffic(network, way, made, rng), way.ego)


def _grounded(pieces: list[Piece], area: shapely.Geometry) -> list[Piece]:
    """Those that stand on the ground of an area."""
    return [piece for piece in pieces if piece.material is not Material.OVERHEAD and shapely.intersects(area, piece.shape)]


def _cleared(pieces: list[Piece], ego: Track) -> list[Piece]:
    """Without what the ego would hit: a map is not exact to a car's width, and posts and parked cars are ours."""
    hinders = in_the_way([piece.shape for piece in pieces], swept(ego_corners(ego, BODY)))
    return [piece for piece, hinder in zip(pieces, hinders, strict=True) if not hinder]


def _house(area: Area, rng: np.random.Generator) -> list[Piece]:
    """With the height that is tagged, or a likely one; roofs on posts are overhead."""
    tags = area.tags
    levels, low_levels = metres(tags.get("building:levels")), metres(tags.get("building:min_level"))
    usual = rng.uniform(3.0, 4.5) if area.polygon.area < 60.0 else rng.uniform(6.0, 16.0)
    top = metres(tags.get("height")) or (levels * STOREY + 1.5 if levels else usual)
    bottom = metres(tags.get("min_height")) or (low_levels * STOREY if low_levels else 0.0)
    roof = tags["building"] in ("roof", "carport") or tags.get("layer", "0") not in ("0", "")
    if roof or bottom > 2.0:
        return [Piece(Material.OVERHEAD, part, max(top, bottom + 1.0, 4.0), max(bottom, 3.0)) for part in without_holes(area.polygon)]
    return [Piece(Material.BUILDING, part, max(top, 2.0)) for part in without_holes(area.polygon)]


def _mapped(extract: Extract, rng: np.random.Generator) -> list[Piece]:
    """Barriers, trees, lamp posts and bollards."""
    pieces: list[Piece] = []
    for way in extract.barriers:
        pieces += _barrier(way)
    for way in extract.rows:
        for place in np.arange(0.0, length(way.line), rng.uniform(6.0, 10.0)):
            pieces += tree(frame_at(way.line, place), rng)
    for x, y, tags in extract.points:
        pieces += tree(SE2(x, y, 0.0), rng) if tags.get("natural") == "tree" else [_post(x, y, tags)]
    return pieces


def _barrier(way: Way) -> list[Piece]:
    material, usual = BARRIERS.get(way.tags["barrier"], (None, 0.0))
    if way.tags["barrier"] == "bollard":
        return [_post(x, y, way.tags) for x, y in along(way.line, np.arange(0.0, length(way.line), 1.5)).tolist()]
    if material is None:
        return []
    line = shapely.linestrings(way.line)
    shape = shapely.buffer(line, 0.4, cap_style="flat") if material is Material.HEDGE else line
    return [Piece(material, part, metres(way.tags.get("height")) or usual) for part in _simple(shape)]


def _simple(shape: shapely.Geometry) -> list[shapely.Geometry]:
    """A hedge around something has a hole."""
    return without_holes(shape) if shape.geom_type == "Polygon" else [shape]


def _post(x: float, y: float, tags: Tags) -> Piece:
    lamp = tags.get("highway") == "street_lamp"
    return solid(Material.POLE, disc(x, y, 0.1, 6), 6.0 if lamp else 0.95, whole=True)


def _lot(lot: Area, style: Style, rng: np.random.Generator) -> list[Piece]:
    """Rows of parked cars, aisles between them, along the longer side of a parking area on the ground."""
    if lot.tags.get("parking", "surface") not in ("surface", "lane", "street_side"):
        return []
    corners: Floats = shapely.get_coordinates(shapely.oriented_envelope(lot.polygon))[:4]
    sides = np.roll(corners, -1, axis=0) - corners
    longest = int(np.hypot(*sides.T).argmax())
    across = sides[(longest + 1) % 4]
    frame = frame_at(np.array((corners[longest], corners[(longest + 1) % 4])), 0.0)
    left = float((frame.inverse().apply((corners[longest] + across)[None]))[0, 1])
    sign, deep, long = np.sign(left), abs(left), float(np.hypot(*sides[longest]))
    cars = []
    for row in np.arange(2.7, deep - 2.2, 16.3).tolist() + np.arange(13.6, deep - 2.2, 16.3).tolist():
        for place in np.arange(1.4, long - 1.2, 2.6):
            if rng.random() < style.parked:
                turn = np.pi / 2 * rng.choice((-1.0, 1.0)) + rng.normal(0, style.skew)
                cars.append(parked(frame @ SE2(place + rng.normal(0, 0.1), sign * (row + rng.normal(0, 0.15)), turn), rng))
    shapely.prepare(lot.polygon)
    return [car for car in cars if shapely.contains(lot.polygon, car.shape)]
