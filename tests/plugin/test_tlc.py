"""Time to lane crossing against a brute-force search at 1 ms, and by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from manoeuvre import drive
from test_prediction import motion, speed

from plugin.motion.prediction import (
    PredictionSettings,
    constant_radius,
    constant_velocity,
    predict,
    predictor,
)
from plugin.warning.tlc import time_to_lane_crossing
from sumo_net.batch import select
from sumo_net.vehicle import Vehicle

HALF = Vehicle()
PAPER = predictor(HALF, PredictionSettings(mode="paper", curvature_reach_m=1e3))
INSIDE_M = 1.875 - 0.75  # the car's centre may be so far off before a wheel is on the border


def brute_force(truth):
    """First time at which a front wheel's edge is beyond a border (1.875 m from the centre), and its side."""
    axle = truth.offset_m + 0.9 * np.sin(truth.heading_rad)
    wheel = 0.75 * np.cos(truth.heading_rad)
    left, right = axle + wheel >= 1.875, axle - wheel <= -1.875
    if not (left | right).any():
        return np.inf, 0
    first = int(np.argmax(left | right))
    return truth.time_s[first], 1 if left[first] else -1


CASES = [
    # v, steer, curvature, rate, start (v_y, γ, s, d, ψ)
    (25.0, 0.000, 0.000, 0.0, (0.0, 0.0, 0.0, 0.3, 0.02)),
    (25.0, 0.000, 0.000, 0.0, (0.0, 0.0, 0.0, -0.3, -0.015)),
    (33.0, 0.003, 0.000, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0)),
    (25.0, 0.000, 0.002, 0.0, (0.0, 0.0, 0.0, 0.2, 0.0)),
    (25.0, 0.002, 0.002, -1e-5, (0.02, 0.01, 0.0, -0.2, 0.01)),
    (15.0, -0.004, -0.001, 2e-5, (0.02, 0.01, 0.0, 0.5, 0.01)),
    (12.0, 0.000, 0.000, 0.0, (0.0, 0.0, 0.0, 0.0, 0.001)),
]


@pytest.mark.parametrize("case", CASES)
def test_against_a_search_at_1_ms(case):
    v, steer, k, rate, start = case
    truth = drive(HALF, lambda *_: steer, lambda t: v, lambda s: k + rate * s, 3.0, start, 0.001, 1)
    want, side = brute_force(truth)
    m = motion(start[0], start[1], steer, start[3], start[4], k, rate)
    got = time_to_lane_crossing(m, predict(m, speed(v, m), PAPER), PAPER.step_s, HALF)
    assert got.tlc_s[0] == pytest.approx(want, abs=0.01)
    assert got.side[0] == side


@pytest.mark.parametrize("step_s", [0.05, 0.2])
def test_points_of_the_path_may_lie_closer_or_further_apart(step_s):
    fine = predictor(HALF, PredictionSettings(step_s=step_s))
    m = motion(offset=0.3, heading=0.02)
    got = time_to_lane_crossing(m, constant_velocity(m, speed(25.0, m), fine), fine.step_s, HALF)
    coarse = time_to_lane_crossing(m, constant_velocity(m, speed(25.0, m), PAPER), PAPER.step_s, HALF)
    assert got.tlc_s == pytest.approx(coarse.tlc_s, abs=0.01)


def test_constant_velocity_is_gap_over_drift():
    m = motion(lateral_speed=[0.5, -0.4, 0.0, 0.2], offset=[0.3, 0.0, 0.5, 0.0])
    got = time_to_lane_crossing(m, constant_velocity(m, speed(25.0, m), PAPER), PAPER.step_s, HALF)
    assert got.tlc_s == pytest.approx([(INSIDE_M - 0.3) / 0.5, INSIDE_M / 0.4, np.inf, np.inf])
    assert got.side.tolist() == [1, -1, 0, 0]
    assert got.gap_left_m == pytest.approx([INSIDE_M - 0.3, INSIDE_M, INSIDE_M - 0.5, INSIDE_M])


def test_gaps_are_those_of_the_front_wheels_of_a_turned_vehicle():
    m = motion(offset=0.3, heading=0.1)
    got = time_to_lane_crossing(m, constant_velocity(m, speed(25.0, m), PAPER), PAPER.step_s, HALF)
    axle, wheel = 0.3 + 0.9 * np.sin(0.1), 0.75 * np.cos(0.1)
    assert got.gap_left_m[0] == pytest.approx(1.875 - axle - wheel)
    assert got.gap_right_m[0] == pytest.approx(1.875 + axle - wheel)


def test_constant_radius_against_the_closed_form():
    # heading along the lane on a circle of curvature κ: d = v² κ t² / 2 for small angles; the front axle
    # lies l_f v κ t farther
    v, yaw = 25.0, 0.04
    m = motion(yaw_rate=yaw)
    got = time_to_lane_crossing(m, constant_radius(m, speed(v, m), PAPER), PAPER.step_s, HALF)
    t = (-0.9 * yaw + np.sqrt((0.9 * yaw) ** 2 + 2 * v * yaw * INSIDE_M)) / (v * yaw)
    assert got.tlc_s[0] == pytest.approx(t, abs=0.01)


def test_outside_already_is_zero():
    m = motion(offset=[1.2, -1.3, 1.1], heading=[-0.01, 0.01, 0.0])
    got = time_to_lane_crossing(m, predict(m, speed(25.0, m), PAPER), PAPER.step_s, HALF)
    assert got.tlc_s[:2].tolist() == [0.0, 0.0]
    assert got.side.tolist()[:2] == [1, -1]
    assert got.tlc_s[2] > 0.0


def test_one_lane_both_sides():
    m = motion(lateral_speed=0.5)
    path = constant_velocity(m, speed(25.0, m), PAPER)
    wide = time_to_lane_crossing(m, path, PAPER.step_s, HALF)
    narrow = time_to_lane_crossing(m, path, PAPER.step_s, HALF, np.array([1.0]))
    assert narrow.left_s[0] == pytest.approx(wide.left_s[0] - 0.25 / 0.5)
    assert np.isinf(wide.right_s[0])


def test_unknown_motion_has_no_tlc():
    m = motion(offset=[np.nan, 0.0])
    got = time_to_lane_crossing(m, predict(m, speed(25.0, m), PAPER), PAPER.step_s, HALF)
    assert np.isnan(got.tlc_s[0])
    assert got.side[0] == 0
    assert np.isinf(got.tlc_s[1])


@given(offset=st.floats(-1.0, 1.0), drift=st.floats(0.2, 2.0), more=st.floats(0.05, 1.0))
def test_tlc_falls_as_the_drift_grows(offset, drift, more):
    m = motion(lateral_speed=[drift, drift + more], offset=offset)
    got = time_to_lane_crossing(m, constant_velocity(m, speed(25.0, m), PAPER), PAPER.step_s, HALF)
    assert got.tlc_s[1] < got.tlc_s[0] or np.isinf(got.tlc_s).all()


@given(values=st.tuples(*(st.floats(-1, 1) for _ in range(7))), v=st.floats(0.0, 40.0))
def test_mirror(values, v):
    scaled = np.array(values) * [0.3, 0.1, 0.01, 1.0, 0.05, 0.004, 3e-5]
    both = motion(*np.stack([scaled, -scaled], axis=1))
    got = time_to_lane_crossing(both, predict(both, speed(v, both), PAPER), PAPER.step_s, HALF)
    assert got.tlc_s[0] == got.tlc_s[1]
    assert got.left_s[0] == got.right_s[1]
    assert got.side[0] == -got.side[1] or got.left_s[0] == got.right_s[0]


def test_order_and_slices_change_nothing():
    rng = np.random.default_rng(2)
    m = motion(lateral_speed=rng.normal(0, 0.5, 6), offset=rng.uniform(-1.3, 1.3, 6))
    v = rng.uniform(10, 35, 6)

    def crossing(part):
        some = select(m, part)
        return time_to_lane_crossing(some, predict(some, v[part], PAPER), PAPER.step_s, HALF)

    whole, order = crossing(slice(None)), np.array([5, 0, 3, 2, 4, 1])
    for a, b, c in zip(whole, crossing(order), crossing(slice(2, 5)), strict=True):
        np.testing.assert_array_equal(a[order], b)
        np.testing.assert_array_equal(a[2:5], c)
