"""Rays from radars to detections, drawn as cells: what Elfes' model is made of, and where there is surely nothing."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.messages import Floats

MOST_POINTS = 1 << 16  # of rays that are worked on at once: they stay in the processor's cache


def traced(points: Floats, origins: Floats, spec: GridSpec, beam: BeamModel) -> Floats:
    """(2, H, W): how many detections' beams pass a cell, and how many may end in it, each of weight 1 over its rays.

    points, origins: (N, 2) in base, m. inverse_sensor_model's beam for many detections at once, each from where it was measured: the
    log-odds of a detection are `free` times the first and `occupied` times the second.
    """
    sigmas = np.linspace(-2, 2, beam.rays)
    weights = np.exp(-(sigmas**2) / 2) / np.exp(-(sigmas**2) / 2).sum()
    way = points - origins
    distance = np.repeat(np.hypot(way[:, 0], way[:, 1]), beam.rays)
    angle = (np.arctan2(way[:, 1], way[:, 0])[:, None] + sigmas * beam.beam_sigma).reshape(-1)
    start, ray = np.repeat(origins, beam.rays, axis=0), np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    weight = np.tile(weights, len(points))
    out = np.zeros((2, spec.cells**2))
    counts = np.maximum(np.ceil((distance - beam.margin * spec.cell) / (spec.cell / 2) - 1), 0).astype(np.intp)  # points of each ray
    for some in _portions(counts):
        cells, which = _passed(start[some], ray[some], counts[some], spec)
        out[0] += np.bincount(cells, weights=weight[some][which], minlength=spec.cells**2)
    ends = spec.locate(start + distance[:, None] * ray)
    out[1] = np.bincount(ends[ends >= 0], weights=weight[ends >= 0], minlength=spec.cells**2)
    return out.reshape(2, spec.cells, spec.cells)


def _portions(counts: NDArray[np.intp]) -> list[slice]:
    """Runs of rays with about MOST_POINTS points each."""
    portion = np.cumsum(counts) // MOST_POINTS
    edges = [0, *(np.flatnonzero(np.diff(portion)) + 1).tolist(), len(counts)]
    return [slice(first, last) for first, last in pairwise(edges) if last > first]


def _passed(start: Floats, ray: Floats, counts: NDArray[np.intp], spec: GridSpec) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Flat cells that rays pass, once each, and the ray: at points half a cell apart, the first half a cell from the radar."""
    which = np.repeat(np.arange(len(counts)), counts)
    along = (np.arange(1, len(which) + 1) - np.repeat(np.cumsum(counts) - counts, counts)) * (spec.cell / 2)  # m
    column, row = (
        np.floor((np.repeat(start[:, axis], counts) + along * np.repeat(ray[:, axis], counts) + spec.half) / spec.cell).astype(np.intp)
        for axis in (0, 1)
    )
    cells = row * spec.cells + column
    new = np.ones(len(cells), dtype=bool)  # a straight ray never comes back to a cell
    new[1:] = (cells[1:] != cells[:-1]) | (which[1:] != which[:-1])
    new &= (column >= 0) & (column < spec.cells) & (row >= 0) & (row < spec.cells)
    return cells[new], which[new]
