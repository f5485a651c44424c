"""A town from above, drawn by material."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from echogrid.core.messages import Floats
from echogrid_training.driving.ego_drive import BODY
from echogrid_training.towns.clearance import ego_corners, mover_corners
from echogrid_training.towns.town import Material, Town

COLOURS = {
    Material.BUILDING: (120, 80, 70),
    Material.WALL: (170, 110, 60),
    Material.CAR: (40, 90, 180),
    Material.POLE: (200, 30, 30),
    Material.TREE: (30, 110, 30),
    Material.HEDGE: (90, 160, 60),
    Material.FENCE: (150, 150, 90),
    Material.GUARD_RAIL: (90, 90, 130),
    Material.KERB: (185, 185, 185),
    Material.OVERHEAD: (225, 200, 235),
    Material.CONE: (255, 90, 0),
    Material.BARRIER: (220, 40, 90),
    Material.BICYCLE: (150, 60, 200),
    Material.PLATE: (140, 140, 150),
    Material.PEDESTRIAN: (230, 120, 0),
    Material.CYCLIST: (200, 0, 160),
}
PAPER, ROAD, EGO = (250, 250, 247), (232, 232, 232), (0, 150, 150)
FILLED = {Material.BUILDING: (222, 205, 198), Material.CAR: (170, 195, 235), Material.HEDGE: (200, 225, 185)}


def draw_town(
    town: Town, pixels_per_m: float = 4.0, window: tuple[float, float, float, float] | None = None, ego: bool = True
) -> Image.Image:
    """North up; all of it or a window (west, south, east, north) m; movers where they start, with the way they go."""
    if window is None:
        window = (town.ego.x.min() - 50.0, town.ego.y.min() - 50.0, town.ego.x.max() + 50.0, town.ego.y.max() + 50.0)
    west, south, east, north = window
    image = Image.new("RGB", (max(1, round((east - west) * pixels_per_m)), max(1, round((north - south) * pixels_per_m))), PAPER)
    pen = ImageDraw.Draw(image)

    def at(points: Floats) -> list[tuple[float, float]]:
        return list(map(tuple, ((points - (west, north)) * (pixels_per_m, -pixels_per_m)).tolist()))

    for road in town.roads:
        pen.line(at(road.line), fill=ROAD, width=max(1, round(road.width * pixels_per_m)), joint="curve")
    for thing in sorted(town.things, key=lambda thing: thing.material is not Material.OVERHEAD):
        if thing.closed and thing.material in FILLED:
            pen.polygon(at(thing.outline), fill=FILLED[thing.material])
        for segment in thing.segments():
            pen.line(
                at(segment),
                fill=COLOURS[thing.material],
                width=2 if thing.material in (Material.WALL, Material.FENCE, Material.BUILDING) else 1,
            )
    for mover in town.movers:
        pen.line(at(np.stack((mover.track.x, mover.track.y), axis=-1)), fill=COLOURS[mover.material], width=1)
        pen.polygon(at(mover_corners(mover)[0]), fill=COLOURS[mover.material])
    if ego:
        outlines = ego_corners(town.ego, BODY)
        pen.line(at(np.stack((town.ego.x, town.ego.y), axis=-1)), fill=EGO, width=2)
        for outline in outlines[:: len(outlines) // 12]:
            pen.polygon(at(outline), outline=EGO)
        pen.polygon(at(outlines[0]), fill=EGO)
    return image
