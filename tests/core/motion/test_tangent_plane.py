"""Latitude and longitude in metres, against the radii of curvature, against a way along the meridian, and against vectors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.motion.tangent_plane import TangentPlane

A, B = 6378137.0, 6356752.314245  # m: WGS 84's semi-axes
LATITUDES, LONGITUDES = st.floats(-1.45, 1.45), st.floats(-math.pi, math.pi)


@given(LATITUDES, LONGITUDES, st.floats(-100, 100), st.floats(-100, 100))
def test_near_the_origin_it_is_the_radii_of_curvature(latitude: float, longitude: float, east: float, north: float) -> None:
    e2 = 1 - (B / A) ** 2
    w = math.sqrt(1 - e2 * math.sin(latitude) ** 2)
    meridian, normal = A * (1 - e2) / w**3, A / w
    place = TangentPlane(latitude, longitude).place(latitude + north / meridian, longitude + east / (normal * math.cos(latitude)))
    assert place == pytest.approx((east, north), abs=0.012)  # the curvature of what is called straight here


def test_the_poles_are_nearer_to_the_equator_s_plane_by_the_flattening() -> None:
    """Seen from the equator, the pole lies as high as the semi-minor axis is long."""
    assert TangentPlane(0.0, 0.3).place(math.pi / 2, 0.3)[1] == pytest.approx(B, abs=1e-3)


@given(LATITUDES, LONGITUDES)
def test_the_origin_is_the_origin_and_its_axes_are_axes(latitude: float, longitude: float) -> None:
    plane = TangentPlane(latitude, longitude)
    assert plane.place(latitude, longitude) == pytest.approx((0.0, 0.0), abs=1e-6)
    for yaw in (-3.0, 0.0, 1.0, 3.1):
        assert plane.yaw(latitude, longitude, yaw) == pytest.approx(yaw, abs=1e-12)


@given(st.floats(-1.3, 1.3), LONGITUDES, st.floats(-5e4, 5e4), st.floats(-5e4, 5e4), st.floats(-3, 3))
def test_a_yaw_turns_as_steps_along_it_do(latitude: float, longitude: float, east: float, north: float, yaw: float) -> None:
    """By small differences of places: a step of some metres in the direction of the yaw there."""
    plane = TangentPlane(latitude, longitude)
    e2 = 1 - (B / A) ** 2

    def stepped(phi: float, away: float, e: float, n: float) -> tuple[float, float]:
        w = math.sqrt(1 - e2 * math.sin(phi) ** 2)
        return phi + n * w**3 / (A * (1 - e2)), away + e * w / (A * math.cos(phi))

    there = stepped(latitude, longitude, east, north)
    ahead = stepped(*there, 5 * math.cos(yaw), 5 * math.sin(yaw))
    step = np.subtract(plane.place(*ahead), plane.place(*there))
    difference = plane.yaw(*there, yaw) - math.atan2(step[1], step[0])
    assert math.remainder(difference, math.tau) == pytest.approx(0.0, abs=1e-4)


def test_a_degree_of_latitude_at_45_degrees() -> None:
    """111,131.7 m from 44.5 to 45.5 degrees north, as tables of the meridian have it."""
    plane = TangentPlane(math.radians(45.0), 0.3)
    (_, south), (_, north) = (plane.place(math.radians(at), 0.3) for at in (44.5, 45.5))
    assert north - south == pytest.approx(111131.7, abs=3.0)  # a plane is shorter than the way by a few centimetres per such distance
