"""OpenStreetMap extracts: what of them matters to a car, in metres about the extract's centre."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import osmium
import osmium.osm
import shapely

from echogrid.core.messages import Floats
from echogrid.errors import EchogridError

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563  # WGS 84
Tags = Mapping[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A mapped line (N, 2) m with its tags and, to find where ways meet, the ids (N,) of its nodes."""

    line: Floats
    nodes: tuple[int, ...]
    tags: Tags


@dataclass(frozen=True, slots=True, eq=False)
class Area:
    """A mapped polygon, m, holes and all, with its tags."""

    polygon: shapely.Polygon
    tags: Tags


@dataclass(frozen=True, slots=True, eq=False)
class Extract:
    """What an extract holds of each kind; points are (x, y) m with their tags."""

    buildings: tuple[Area, ...]
    parking: tuple[Area, ...]
    barriers: tuple[Way, ...]
    roads: tuple[Way, ...]
    rows: tuple[Way, ...]  # of trees
    points: tuple[tuple[float, float, Tags], ...]  # trees, lamp posts, bollards


def read_extract(path: Path) -> Extract:
    """From an .osm or .osm.pbf file. Raises EchogridError."""
    if not path.is_file():
        raise EchogridError(f"{path}: there is no such file")
    try:
        areas, ways, points = _read(path)
    except (RuntimeError, ValueError) as error:  # all that osmium raises for files it cannot read
        raise EchogridError(f"{path}: is no OpenStreetMap extract (.osm, .osm.pbf), or a torn one: {_line(error)}") from error
    buildings = [area for area in areas if area[1].get("building", "no") != "no"]
    if not buildings:
        raise EchogridError(f"{path}: holds no building, and a town needs some")
    project = _Projection(np.concatenate([ring for rings, _ in buildings for ring in rings[:1]]))

    def polygon(rings: list[Floats]) -> shapely.Geometry:
        made = shapely.Polygon(project(rings[0]), [project(ring) for ring in rings[1:]])
        return made if shapely.is_valid(made) else shapely.make_valid(made)

    def lines(key: str, value: str | None = None) -> tuple[Way, ...]:
        return tuple(
            Way(project(line), nodes, tags)
            for line, nodes, tags in ways
            if tags.get(key, "no") != "no" and (value is None or tags[key] == value) and tags.get("area") != "yes"
        )

    def split(found: list[tuple[list[Floats], Tags]]) -> tuple[Area, ...]:
        shapes = ((polygon(rings), tags) for rings, tags in found)
        return tuple(Area(part, tags) for shape, tags in shapes for part in shapely.get_parts(shape) if part.geom_type == "Polygon")

    return Extract(
        buildings=split(buildings),
        parking=split([area for area in areas if area[1].get("amenity") == "parking"]),
        barriers=lines("barrier"),
        roads=lines("highway"),
        rows=lines("natural", "tree_row"),
        points=tuple((*project(np.array((place,)))[0].tolist(), tags) for place, tags in points),
    )


_Rings = list[tuple[list[Floats], Tags]]
_Lines = list[tuple[Floats, tuple[int, ...], Tags]]
_Points = list[tuple[tuple[float, float], Tags]]


def _read(path: Path) -> tuple[_Rings, _Lines, _Points]:
    """Areas as rings (outer first), ways and points, all as (longitude, latitude) in degrees."""
    areas: _Rings = []
    ways: _Lines = []
    points: _Points = []
    # In the file's order: an extract's order is its own, so the same file gives the same town.
    for thing in osmium.FileProcessor(str(path)).with_areas().with_filter(osmium.filter.EmptyTagFilter()):
        tags = {tag.k: tag.v for tag in thing.tags}
        if isinstance(thing, osmium.osm.Area):
            if "building" in tags or tags.get("amenity") == "parking":
                for outer in thing.outer_rings():
                    areas.append(([_ring(outer), *(_ring(inner) for inner in thing.inner_rings(outer))], tags))
        elif isinstance(thing, osmium.osm.Way):
            if "highway" in tags or "barrier" in tags or tags.get("natural") == "tree_row":
                known = [node for node in thing.nodes if node.location.valid()]  # at an extract's edge some are missing
                if len(known) > 1:
                    ways.append((np.array([(node.lon, node.lat) for node in known]), tuple(node.ref for node in known), tags))
        elif isinstance(thing, osmium.osm.Node) and (
            tags.get("natural") == "tree" or tags.get("highway") == "street_lamp" or tags.get("barrier") == "bollard"
        ):
            points.append(((thing.lon, thing.lat), tags))
    return areas, ways, points


def _ring(nodes: osmium.osm.OuterRing | osmium.osm.InnerRing) -> Floats:
    return np.array([(node.lon, node.lat) for node in nodes])


class _Projection:
    """Longitude and latitude (N, 2) in degrees to x east, y north in m about the middle of these; true to 1e-4 within 5 km of it."""

    def __init__(self, places: Floats) -> None:
        self._centre = (places.min(axis=0) + places.max(axis=0)) / 2
        sine = math.sin(math.radians(self._centre[1]))
        squared = FLATTENING * (2 - FLATTENING)
        bend = 1 - squared * sine * sine
        across = SEMI_MAJOR / math.sqrt(bend) * math.cos(math.radians(self._centre[1]))  # radius of the parallel
        self._per_degree = np.radians((across, SEMI_MAJOR * (1 - squared) / bend**1.5))

    def __call__(self, places: Floats) -> Floats:
        points: Floats = (places - self._centre) * self._per_degree
        return points


def metres(value: str | None) -> float | None:
    """Of a tag like "3.5", "3,5 m" or "12'"; `None` if it says nothing one can use."""
    if value is None:
        return None
    feet = value.strip().endswith("'")
    try:
        number = float(value.replace(",", ".").rstrip("m' ").strip())
    except ValueError:
        return None
    return number * 0.3048 if feet else number


def _line(error: Exception) -> str:
    return " ".join(str(error).split())
