"""Generated towns: a street plan, a drive through it, and along the drive everything that lines and fills its streets."""

from __future__ import annotations

import numpy as np
import shapely

from echogrid.errors import EchogridError
from echogrid_training.driving.ego_drive import BODY, Drive, drive
from echogrid_training.driving.traffic import traffic
from echogrid_training.streets.network import Kind, Network, Street
from echogrid_training.streets.shapes import length
from echogrid_training.streets.streets import StreetPlan, plan_streets
from echogrid_training.streets.style import FAMILIES, Style, draw
from echogrid_training.towns.carriageway import carriageways
from echogrid_training.towns.clearance import ego_corners, in_the_way, swept
from echogrid_training.towns.enclosure import car_park, court, storey
from echogrid_training.towns.fronts import fronts
from echogrid_training.towns.furniture import along_street, at_crossings, bridge, island, kerbs
from echogrid_training.towns.parking import beside
from echogrid_training.towns.piece import Piece, cut, merged, things, within
from echogrid_training.towns.roadside import along_road
from echogrid_training.towns.town import Material, Road, Thing, Town

SIGHT = 45.0  # m about the ego's way that is furnished
COURT = 600.0  # m²; larger open areas are car parks


def make_town(family: str, seed: int, seconds: float) -> Town:
    """A town of the family "train", "calibration" or "test" and a drive of so many seconds through it; the same bits every time."""
    if family not in FAMILIES:
        raise EchogridError(f"there is no family of towns '{family}', only {', '.join(FAMILIES)}")
    rng = np.random.default_rng(np.random.SeedSequence((list(FAMILIES).index(family), seed)))
    while True:  # some plans have no way through them that is long enough
        style = draw(FAMILIES[family], rng)
        plan = plan_streets(style, rng)
        way = drive(plan.network, seconds, rng)
        if way is not None:
            break
    near = [street for street in plan.network.streets if shapely.intersects(corridor(way), shapely.linestrings(street.line))]
    standing = _furnished(plan, near, way, style, rng)
    roads = tuple(Road(street.line, street.width) for street in near)
    return Town(f"{family}-{seed}-{style.layout}", family, seed, standing, roads, traffic(plan.network, way, standing, rng), way.ego)


def corridor(way: Drive) -> shapely.Geometry:
    """What is within SIGHT of the drive."""
    line = shapely.simplify(shapely.linestrings(np.stack((way.ego.x, way.ego.y), axis=-1)[::50]), 0.5)
    area = shapely.buffer(line, SIGHT, quad_segs=4)
    shapely.prepare(area)
    return area


def _furnished(plan: StreetPlan, near: list[Street], way: Drive, style: Style, rng: np.random.Generator) -> tuple[Thing, ...]:
    """All that stands along the streets `near` the drive."""
    network, area = plan.network, corridor(way)
    ground = carriageways(network, near)
    bands = shapely.union_all([ground, *(shapely.buffer(shapely.polygons(street.band()), 0.0) for street in near)])
    taken = shapely.union_all([bands, *(shapely.polygons(outline) for outline in plan.open)])

    structures, clear = _bridges(near, way, plan, style, rng)
    taken = shapely.union_all([taken, *clear])
    lined = [piece for street in near for piece in fronts(network, street, style, rng)]
    parked = [car for street in near for car in beside(network, street, style, rng)]
    enclosed = _enclosed(plan, near, style, rng)
    placed = [piece for street in near for piece in along_street(network, street, style, rng)] + at_crossings(network, rng)
    placed += [piece for x, y, radius in plan.islands for piece in island(x, y, radius, rng)]

    everything = [piece for piece in (*structures, *lined, *parked, *enclosed, *placed) if shapely.intersects(area, piece.shape)]
    above = [piece for piece in everything if piece.material is Material.OVERHEAD]
    here = {id(piece) for piece in everything} - {id(piece) for piece in above}

    def kept(pieces: list[Piece]) -> list[Piece]:
        return [piece for piece in pieces if id(piece) in here]

    houses = cut([piece for piece in kept(lined) if piece.material is Material.BUILDING], taken, least_area=20.0)
    gardens = cut([piece for piece in kept(lined) if piece.material is not Material.BUILDING], taken)
    # First come, first served: what was built first stands, what can be moved gives way.
    pieces = merged([*kept(structures), *kept(enclosed), *houses, *gardens, *kept(parked), *cut(kept(placed), ground)])
    small = _small(network, near, style, area, rng)
    pieces += merged([piece for piece in small if piece.material is not Material.PLATE], pieces)
    plates = [piece for piece in small if piece.material is Material.PLATE]
    hindering = in_the_way([piece.shape for piece in pieces], swept(ego_corners(way.ego, BODY)))
    pieces = [piece for piece, hinders in zip(pieces, hindering, strict=True) if not hinders]
    return tuple(things([*pieces, *above, *plates, *within(kerbs(ground), area)]))


def _small(network: Network, near: list[Street], style: Style, area: shapely.Geometry, rng: np.random.Generator) -> list[Piece]:
    """What is small, beside and on the road."""
    if style.small <= 0.0:
        return []
    return [piece for street in near for piece in along_road(network, street, style, rng) if shapely.intersects(area, piece.shape)]


def _bridges(
    near: list[Street], way: Drive, plan: StreetPlan, style: Style, rng: np.random.Generator
) -> tuple[list[Piece], list[shapely.Geometry]]:
    """In some towns a railway over one of the streets that are driven, and what it keeps clear of houses."""
    driven = [plan.network.streets[leg.street] for leg in way.legs[:5]]
    fit = [street for street in driven if street in near and street.kind is Kind.STREET and length(street.line) > 45.0]
    if style.layout == "multi_storey" or not fit or rng.random() > 0.3:
        return [], []
    pieces, outline = bridge(fit[int(rng.integers(len(fit)))], rng)
    return pieces, [shapely.polygons(outline)]


def _enclosed(plan: StreetPlan, near: list[Street], style: Style, rng: np.random.Generator) -> list[Piece]:
    """What stands in and about the open areas."""
    ways = shapely.union_all(
        [shapely.buffer(shapely.linestrings(street.line), street.width / 2) for street in near if street.kind is not Kind.STREET]
    )
    inside: list[Piece] = []
    for outline in plan.open:
        if style.layout == "multi_storey":
            inside += storey(outline, ways, plan.network, rng)
        elif shapely.area(shapely.polygons(outline)) > COURT:
            inside += car_park(outline, ways, plan.network, style, rng)
        else:
            inside += court(outline, ways, style, rng)
    return inside
