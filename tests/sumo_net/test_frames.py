"""Planar frames: inverses, and answers one can compute by hand."""

import cmath
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_net import frames

angles = st.floats(-50.0, 50.0)
places = st.floats(-1e4, 1e4)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (3.0 * math.pi / 2.0, -math.pi / 2.0),
        (-7.0, -7.0 + math.tau),
    ],
)
def test_wrap_angle(angle, wrapped):
    assert frames.wrap_angle(angle) == pytest.approx(wrapped)


@settings(max_examples=30)
@given(angles)
def test_wrapped_angle_is_the_same_direction(angle):
    wrapped = frames.wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-12)


@pytest.mark.parametrize(
    ("sumo_deg", "heading"),
    [(0.0, math.pi / 2.0), (90.0, 0.0), (180.0, -math.pi / 2.0), (315.0, 0.75 * math.pi)],
)
def test_sumo_angle_is_clockwise_from_north(sumo_deg, heading):
    assert frames.heading_from_sumo_angle(sumo_deg) == pytest.approx(heading)


def test_left_of_a_vehicle_heading_north_is_west():
    assert frames.vehicle_from_world(-3.0, 10.0, 0.0, 0.0, math.pi / 2.0) == pytest.approx((10.0, 3.0))


@settings(max_examples=30)
@given(places, places, places, places, angles)
def test_a_point_in_the_vehicle_frame_is_the_world_turned_back(x, y, origin_x, origin_y, heading):
    turned = complex(x - origin_x, y - origin_y) * cmath.exp(-1j * heading)
    forward, left = frames.vehicle_from_world(x, y, origin_x, origin_y, heading)
    assert complex(forward, left) == pytest.approx(turned, abs=1e-8)
