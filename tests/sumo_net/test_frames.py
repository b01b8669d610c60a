"""Planar frames: inverses, and answers one can compute by hand."""

import math

import numpy as np
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
    assert frames.sumo_angle_from_heading(heading) == pytest.approx(sumo_deg)


def test_left_of_a_vehicle_heading_north_is_west():
    assert frames.vehicle_from_world(-3.0, 10.0, 0.0, 0.0, math.pi / 2.0) == pytest.approx((10.0, 3.0))


@settings(max_examples=30)
@given(places, places, places, places, angles)
def test_vehicle_and_world_invert(x, y, origin_x, origin_y, heading):
    forward, left = frames.vehicle_from_world(x, y, origin_x, origin_y, heading)
    assert frames.world_from_vehicle(forward, left, origin_x, origin_y, heading) == pytest.approx(
        (x, y), abs=1e-8
    )


def test_bumper_and_center_invert_for_arrays():
    x, y, heading = np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.array([0.0, math.pi / 2.0])
    center = frames.center_from_bumper(x, y, heading, 1.6)
    np.testing.assert_allclose(center, [[-0.6, 2.0], [3.0, 2.4]])
    np.testing.assert_allclose(frames.bumper_from_center(*center, heading, 1.6), [x, y])
