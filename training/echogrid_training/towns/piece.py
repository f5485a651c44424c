"""Things in the making: shapes that may still be cut or left out where there is no room."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid_training.towns.town import Material, Thing


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A polygon or line string, m, with material and heights. `whole`: left out rather than cut where something else stands."""

    material: Material
    shape: shapely.Geometry
    top: float
    bottom: float = 0.0
    whole: bool = False


def solid(material: Material, outline: Floats, top: float, bottom: float = 0.0, whole: bool = False) -> Piece:
    """Of a closed outline (N, 2)."""
    return Piece(material, shapely.polygons(outline), top, bottom, whole)


def sheet(material: Material, line: Floats, top: float, bottom: float = 0.0) -> Piece:
    """Thin, along an open line (N, 2)."""
    return Piece(material, shapely.linestrings(line), top, bottom)


def cut(pieces: Sequence[Piece], taken: shapely.Geometry, least_area: float = 12.0, least_length: float = 1.0) -> list[Piece]:
    """The pieces without what is taken: whole ones drop out if they touch it, others lose that part, and slivers vanish."""
    if not pieces:
        return []
    shapely.prepare(taken)
    touched = shapely.intersects(taken, [piece.shape for piece in pieces])
    kept = []
    for piece, touches in zip(pieces, touched, strict=True):
        if not touches:
            kept.append(piece)
        elif not piece.whole:
            kept += parts(piece, shapely.difference(piece.shape, taken), least_area, least_length)
    return kept


def parts(piece: Piece, shape: shapely.Geometry, least_area: float = 12.0, least_length: float = 1.0) -> list[Piece]:
    """What is left of a piece, as simple polygons without holes and lines, the small ones dropped."""
    kept = []
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon":
            kept += [replace(piece, shape=one) for one in without_holes(part) if one.area >= min(least_area, 0.5 * piece.shape.area)]
        elif part.geom_type == "LineString" and part.length >= least_length:
            kept.append(replace(piece, shape=part))
    return kept


def without_holes(polygon: shapely.Polygon) -> list[shapely.Polygon]:
    """The polygon sawn through its holes, so that the outline of each part is all there is to it."""
    if not polygon.interiors:
        return [polygon]
    hole = shapely.centroid(shapely.polygons(polygon.interiors[0]))
    low_x, low_y, high_x, high_y = polygon.bounds
    left = shapely.box(low_x - 1, low_y - 1, hole.x, high_y + 1)
    right = shapely.box(hole.x, low_y - 1, high_x + 1, high_y + 1)
    halves = [part for half in (left, right) for part in shapely.get_parts(shapely.intersection(polygon, half))]
    return [one for half in halves if half.geom_type == "Polygon" for one in without_holes(half)]


def merged(pieces: Sequence[Piece], standing: Sequence[Piece] = ()) -> list[Piece]:
    """The pieces, each without what those before it (and `standing`) already cover: first come, first served."""
    if not pieces:
        return []
    shapes = [piece.shape for piece in (*standing, *pieces)]
    pairs = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    before: dict[int, list[int]] = {}
    for one, other in sorted(zip(*pairs.tolist(), strict=True)):
        if other < one:
            before.setdefault(one, []).append(other)
    left: dict[int, list[Piece]] = {index: [piece] for index, piece in enumerate(standing)}
    for index, piece in enumerate(pieces, len(standing)):
        others = [other.shape for place in before.get(index, ()) for other in left[place]]
        left[index] = cut([piece], shapely.union_all(others)) if others else [piece]
    return [piece for index in range(len(standing), len(shapes)) for piece in left[index]]


def within(lines: Sequence[Piece], area: shapely.Geometry) -> list[Piece]:
    """Of pieces along lines, what lies in the area."""
    kept = []
    for piece in lines:
        shape = shapely.intersection(piece.shape, area)
        joined = shapely.line_merge(shape) if shape.geom_type == "MultiLineString" else shape
        kept += parts(piece, joined)
    return kept


def things(pieces: Iterable[Piece]) -> list[Thing]:
    """As they stand in a town: closed outlines counter-clockwise, corners within 2 cm of a straight side left out."""
    made = []
    for piece in pieces:
        shape = shapely.simplify(piece.shape, 0.02)
        if shape.is_empty:
            continue
        closed = shape.geom_type == "Polygon"
        if closed:
            outline = shapely.get_coordinates(shapely.orient_polygons(shapely.polygons(shape.exterior)))[:-1]
        else:
            outline = shapely.get_coordinates(shape)
        if len(outline) >= (3 if closed else 2):
            made.append(Thing(piece.material, np.ascontiguousarray(outline), closed, float(piece.bottom), float(piece.top)))
    return made
