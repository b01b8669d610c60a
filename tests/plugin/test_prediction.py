"""Predicted paths against the independent integrator, and against what can be computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from manoeuvre import drive
from scipy.integrate import solve_ivp

from plugin.motion.estimate import MotionEstimate
from plugin.motion.prediction import (
    PredictionSettings,
    constant_radius,
    constant_velocity,
    predict,
    predictor,
)
from plugin.motion.prediction_kernels import hold, travel, unrest_share
from sumo_net.batch import select
from sumo_net.vehicle import Vehicle, model, single_track, steady_state, zero_order_hold

HALF = Vehicle()
METHODS = {"predict": predict, "constant velocity": constant_velocity, "constant radius": constant_radius}


def motion(
    lateral_speed=0.0,
    yaw_rate=0.0,
    steer=0.0,
    offset=0.0,
    heading=0.0,
    curvature=0.0,
    curvature_rate=0.0,
    quick=0.0,
):
    values = (lateral_speed, yaw_rate, steer, quick, offset, heading, curvature, curvature_rate, 3.75, np.inf)
    parts = np.broadcast_arrays(*(np.atleast_1d(np.asarray(value, float)) for value in values))
    return MotionEstimate(*(np.ascontiguousarray(part) for part in parts), np.zeros(len(parts[0]), np.int8))


def speed(v, m):
    return np.full(len(m.steer_rad), float(v))


@pytest.mark.parametrize("v", [0.6, 2.0, 8.0, 25.0, 60.0])
def test_hold_is_the_matrix_exponential(v):
    transition, entry = zero_order_hold(*single_track(HALF, v), 0.1)
    e11, e12, e21, e22, g1, g2 = hold(v, model(HALF), 0.1)
    assert np.array([[e11, e12], [e21, e22]]) == pytest.approx(transition, abs=1e-10)
    assert np.array([[g1], [g2]]) == pytest.approx(entry, abs=1e-8)


@pytest.mark.parametrize("kmh", [40, 70, 90, 120])
def test_paper_is_the_single_track_model_with_the_steer_held(kmh):
    v = kmh / 3.6
    start = (0.05, 0.02, 0.0, 0.3, 0.01)
    truth = drive(HALF, lambda *_: 0.004, lambda t: v, lambda s: 0.001 + 1e-5 * s, 3.0, start)
    m = motion(0.05, 0.02, 0.004, 0.3, 0.01, 0.001, 1e-5)
    path = predict(m, speed(v, m), predictor(HALF, PredictionSettings(mode="paper", curvature_reach_m=1e3)))
    assert path.lane_offset_m.shape == (1, 30)
    assert path.lane_offset_m[0] == pytest.approx(truth.offset_m[1:], abs=0.01)
    assert path.lane_heading_rad[0] == pytest.approx(truth.heading_rad[1:], abs=5e-4)


def test_a_step_is_the_integral_of_slip_and_yaw_rate_that_change_linearly():
    v, k, rate, h = 25.0, 0.002, 1e-5, 0.1
    v_y, yaw = (0.3, -0.3), (0.0, 0.3)

    def rates(t, x):
        _, _, heading, s, d, psi = x
        side, turn = (a + (b - a) * t / h for a, b in (v_y, yaw))
        along = (v * np.cos(psi) - side * np.sin(psi)) / (1.0 - d * (k + rate * s))
        return [
            v * np.cos(heading) - side * np.sin(heading),
            v * np.sin(heading) + side * np.cos(heading),
            turn,
            along,
            v * np.sin(psi) + side * np.cos(psi),
            turn - (k + rate * s) * along,
        ]

    start = [0.0, 0.0, 0.0, 0.0, 0.4, 0.02]
    exact = solve_ivp(rates, (0.0, h), start, rtol=1e-10, atol=1e-12).y[:, -1]
    got = travel(*start, v, *v_y, *yaw, k, rate, 1e3, h)
    np.testing.assert_allclose(got, exact, atol=1e-4)


@pytest.mark.parametrize("name", METHODS)
def test_path_in_the_vehicle_frame_and_on_the_lane_are_the_same(name):
    # the lane, integrated finely in the vehicle frame, must carry the vehicle's path
    v, k, rate, d, psi = 25.0, 0.002, 1e-5, 0.4, 0.02
    m = motion(-0.05, 0.06, 0.004, d, psi, k, rate)
    path = METHODS[name](m, speed(v, m), predictor(HALF, PredictionSettings(curvature_reach_m=1e3)))
    s = np.linspace(0.0, 90.0, 90_001)
    direction = -psi + k * s + rate * s**2 / 2
    x = np.concatenate([[0.0], np.cumsum(np.cos(direction[:-1]) * 1e-3)]) + d * np.sin(-psi)
    y = np.concatenate([[0.0], np.cumsum(np.sin(direction[:-1]) * 1e-3)]) - d * np.cos(-psi)
    for j in (0, 9, 19, 29):
        dx, dy = path.forward_m[0, j] - x, path.left_m[0, j] - y
        nearest = int(np.argmin(dx**2 + dy**2))
        aside = -np.sin(direction[nearest]) * dx[nearest] + np.cos(direction[nearest]) * dy[nearest]
        assert path.lane_offset_m[0, j] == pytest.approx(aside, abs=0.01)
        turned = path.heading_rad[0, j] - direction[nearest]
        assert path.lane_heading_rad[0, j] == pytest.approx(turned, abs=2e-3)


def test_steady_turn_of_20_m_a_second_for_2_s_is_a_40_m_arc():
    slip, yaw = steady_state(HALF, 20.0, 0.01)
    m = motion(slip, yaw, 0.01)
    path = predict(m, speed(20.0, m), predictor(HALF, PredictionSettings(mode="paper")))
    radius = np.hypot(20.0, slip) / yaw
    turned = yaw * 2.0
    chord = np.hypot(path.forward_m[0, 19], path.left_m[0, 19])
    assert path.heading_rad[0, 19] == pytest.approx(turned)
    assert chord == pytest.approx(2 * radius * np.sin(turned / 2), rel=1e-3)
    circle = constant_radius(m, speed(20.0, m), predictor(HALF, PredictionSettings()))
    assert circle.left_m[0, 19] == pytest.approx(path.left_m[0, 19], abs=5e-3)


def followed(m, v, settings):
    """(v_y, γ, s, d, ψ) after horizon_s by the continuous equations of the refined prediction, by scipy."""
    c, k, rate = settings, m.curvature_1pm[0], m.curvature_rate_1pm2[0]
    A, B = single_track(HALF, v)
    per = HALF.wheelbase_m + HALF.understeer * v**2
    share = per / max(v, c.slow_mps) ** 2
    stiffness = c.return_gain * c.return_bandwidth_rps**2
    damping = c.return_gain * 2.0 * c.return_damping * c.return_bandwidth_rps

    def back(v_y, d, psi):
        return stiffness * d + damping * (v * np.sin(psi) + v_y * np.cos(psi))

    def rates(t, x):
        v_y, yaw, s, d, psi, residual, u, w = x
        steer = per * (k + rate * (s + c.preview_s * v)) + share * residual + u - w
        along = (v * np.cos(psi) - v_y * np.sin(psi)) / (1.0 - d * (k + rate * s))
        aim = intended * np.exp(-t / c.residual_time_s) - back(v_y, d, psi)
        return [
            *(A @ [v_y, yaw] + B[:, 0] * steer),
            along,
            v * np.sin(psi) + v_y * np.cos(psi),
            yaw - (k + rate * s) * along,
            (aim - residual) / c.steer_lag_s,
            -u / c.unrest_time_s,
            (u - w) / c.unrest_time_s,
        ]

    v_y, d, psi, quick = (part[0] for part in (m.lateral_speed_mps, *m[4:6], m.quick_steer_rad))
    residual = (m.steer_rad[0] - per * (k + rate * c.preview_s * v) - quick) / share
    intended = residual + back(v_y, d, psi)  # at first the driver steers for just what is seen
    start = [v_y, m.yaw_rate_rps[0], 0.0, d, psi, residual, quick, 0.0]
    return solve_ivp(rates, (0.0, c.horizon_s), start, rtol=1e-9, atol=1e-12).y[:5, -1]


@pytest.mark.parametrize("v", [5.0, 12.0, 30.0])
def test_refined_is_the_driver_model_integrated_by_scipy(v):
    m = motion(0.05, 0.02, 0.004, 0.3, 0.01, 0.001, 3e-5, quick=5e-4)
    for step_s in (0.1, 0.01):
        settings = PredictionSettings(step_s=step_s, curvature_reach_m=1e3)
        path = predict(m, speed(v, m), predictor(HALF, settings))
        _, _, _, d, psi = followed(m, v, settings)
        within_m = 0.012 * step_s * v  # a method of the first order
        assert path.lane_offset_m[0, -1] == pytest.approx(d, abs=within_m)
        assert path.lane_heading_rad[0, -1] == pytest.approx(psi, abs=within_m / v)


def test_constant_velocity_follows_the_road_and_drifts():
    m = motion(0.1, 0.0, 0.0, 0.2, 0.01, 0.002)
    path = constant_velocity(m, speed(25.0, m), predictor(HALF, PredictionSettings()))
    drift = 25.0 * np.sin(0.01) + 0.1 * np.cos(0.01)
    assert path.lane_offset_m[0] == pytest.approx(0.2 + drift * 0.1 * np.arange(1, 31))
    assert path.lane_heading_rad[0] == pytest.approx(0.01)


def test_refined_follows_the_road_ahead():
    # on a clothoid, steered for the road: paper runs off, refined stays
    v, k, rate = 25.0, 0.0, 2e-5
    slip, yaw = steady_state(HALF, v, 0.0)
    settings = PredictionSettings()
    per = HALF.wheelbase_m + HALF.understeer * v**2
    m = motion(slip, yaw, per * rate * settings.preview_s * v, 0.0, 0.0, k, rate)
    refined = predict(m, speed(v, m), predictor(HALF, settings))
    held = predict(m, speed(v, m), predictor(HALF, PredictionSettings(mode="paper")))
    assert abs(refined.lane_offset_m[0, 19]) < 0.1
    assert abs(held.lane_offset_m[0, 19]) > 2.5 * abs(refined.lane_offset_m[0, 19])


def test_residual_fades_with_its_time_constant():
    m = motion(steer=0.002)
    offsets = []
    for fade in (0.3, 1.0, 3.0, 1e9):
        settings = PredictionSettings(residual_time_s=fade, return_gain=0.0)
        offsets.append(predict(m, speed(25.0, m), predictor(HALF, settings)).lane_offset_m[0, -1])
    assert np.all(np.diff(offsets) > 0)
    held = predict(m, speed(25.0, m), predictor(HALF, PredictionSettings(mode="paper")))
    assert offsets[-1] == pytest.approx(held.lane_offset_m[0, -1], abs=1e-3)


def test_quick_steer_makes_nothing_for_long():
    # u − w with w = 0 at first sums up to nothing: a share ends as sideways speed, none as heading
    held, quick = motion(steer=0.001, quick=0.0), motion(steer=0.001, quick=0.001)
    free = predictor(HALF, PredictionSettings(return_gain=0.0, residual_time_s=1e9))
    path, other = (predict(m, speed(25.0, m), free) for m in (quick, held))
    assert abs(path.heading_rad[0, -1]) < 0.01 * other.heading_rad[0, -1]
    assert abs(path.left_m[0, -1]) < 0.03 * other.left_m[0, -1]


def test_unknown_share_of_quick_steer_is_what_is_to_be_expected():
    assert unrest_share(1e-4, 3e-4, 3e-4, 0.0) == pytest.approx(0.5)
    assert unrest_share(2e-4, 1e-4, 3e-4, 0.5) == pytest.approx(9.0 / (9.0 + 1.0 + 0.5 * 4.0))
    assert unrest_share(0.02, 3e-4, 3e-4, 0.5) < 1e-3  # a lane change is meant
    unknown, half = motion(steer=0.0, quick=np.nan), motion(steer=0.0, quick=0.0)
    settings = predictor(HALF, PredictionSettings())
    for a, b in zip(*(predict(m, speed(25.0, m), settings) for m in (unknown, half)), strict=True):
        np.testing.assert_array_equal(a, b)
    c, v = PredictionSettings(), 25.0
    calm = c.calm_mps2 * (HALF.wheelbase_m + HALF.understeer * v**2) / v**2
    share = unrest_share(5e-4, calm, c.unrest_rad, c.unrest_doubt)
    unknown, known = motion(steer=5e-4, quick=np.nan), motion(steer=5e-4, quick=5e-4 * share)
    for a, b in zip(*(predict(m, speed(v, m), settings) for m in (unknown, known)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def test_lane_keeping_leads_back_to_the_centre():
    settings = PredictionSettings(horizon_s=10.0, return_gain=1.0, residual_time_s=0.1)
    m = motion(offset=0.8, heading=0.01)
    path = predict(m, speed(25.0, m), predictor(HALF, settings))
    assert abs(path.lane_offset_m[0, -1]) < 0.05
    free = predict(m, speed(25.0, m), predictor(HALF, PredictionSettings(horizon_s=10.0, return_gain=0.0)))
    assert free.lane_offset_m[0, -1] > 3.0


def test_change_of_curvature_is_believed_only_so_far():
    m = motion(curvature_rate=2e-5)
    near = constant_radius(m, speed(30.0, m), predictor(HALF, PredictionSettings(curvature_reach_m=30.0)))
    # beyond 30 m the curvature stays 6e-4: heading of the lane at s is ½ k' 30² + 6e-4 (s − 30)
    assert near.lane_heading_rad[0, -1] == pytest.approx(-(1e-5 * 900 + 6e-4 * 60), rel=0.02)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("v", [0.0, 0.3, 1.0, 4.0])
def test_slow_and_standing(name, v):
    m = motion(0.0, 0.0, 0.02, 0.3, 0.05, 0.01, 1e-4)
    path = METHODS[name](m, speed(v, m), predictor(HALF, PredictionSettings()))
    assert all(np.isfinite(part).all() for part in path)
    assert np.hypot(path.forward_m, path.left_m).max() <= 3.0 * v * 1.1 + 1e-9


@pytest.mark.parametrize("name", METHODS)
def test_unknown_motion_is_an_unknown_path(name):
    m = motion([0.1, np.nan], [0.02, np.nan], [0.004, np.nan], [0.2, np.nan], [0.01, np.nan])
    path = METHODS[name](m, speed(25.0, m), predictor(HALF, PredictionSettings()))
    assert np.isfinite(path.lane_offset_m[0]).all()
    assert np.isnan(path.lane_offset_m[1]).all()
    assert np.isnan(path.left_m[1]).all()


@pytest.mark.parametrize("name", METHODS)
@given(
    values=st.tuples(*(st.floats(-1, 1) for _ in range(7))), v=st.floats(0.0, 40.0), gain=st.floats(0.0, 1.0)
)
def test_mirror(name, values, v, gain):
    scaled = np.array(values) * [0.3, 0.1, 0.01, 1.5, 0.05, 0.004, 3e-5]
    both = motion(*np.stack([scaled, -scaled], axis=1))
    settings = PredictionSettings(return_gain=gain)
    path = METHODS[name](both, speed(v, both), predictor(HALF, settings))
    np.testing.assert_array_equal(path.forward_m[0], path.forward_m[1])
    for part in (path.left_m, path.heading_rad, path.lane_offset_m, path.lane_heading_rad):
        np.testing.assert_array_equal(part[0], -part[1])


def test_order_and_slices_change_nothing():
    rng = np.random.default_rng(1)
    m = motion(*(rng.standard_normal((7, 5)) * np.array([[0.3, 0.1, 0.01, 1, 0.05, 0.004, 3e-5]]).T))
    v, q = rng.uniform(0, 40, 5), predictor(HALF, PredictionSettings())
    whole = predict(m, v, q)
    order = np.array([3, 1, 4, 0, 2])
    mixed = predict(select(m, order), v[order], q)
    part = predict(select(m, slice(1, 4)), v[1:4], q)
    for a, b, c in zip(whole, mixed, part, strict=True):
        np.testing.assert_array_equal(a[order], b)
        np.testing.assert_array_equal(a[1:4], c)


def test_a_bend_that_no_road_begins_with_is_not_expected() -> None:
    """Up to K' v³ = 1.2 m/s³ nothing changes, from 2.4 m/s³ K' counts for nothing; `paper` takes all."""
    v, believed = 30.0, PredictionSettings()
    always = PredictionSettings(road_jerk_mps3=1e9)
    for jerk, same in ((1.19, True), (1.5, False), (2.41, False)):
        seen = motion(heading=0.01, curvature_rate=jerk / v**3)
        paths = [predict(seen, speed(v, seen), predictor(HALF, s)) for s in (believed, always)]
        assert np.allclose(paths[0].lane_offset_m, paths[1].lane_offset_m) == same
    none = motion(heading=0.01)
    path = predict(seen, speed(v, seen), predictor(HALF, believed))
    straight = predict(none, speed(v, none), predictor(HALF, believed))
    np.testing.assert_allclose(path.lane_offset_m, straight.lane_offset_m, atol=1e-12)
    paper = PredictionSettings(mode="paper")
    bent = predict(seen, speed(v, seen), predictor(HALF, paper))
    plain = predict(none, speed(v, none), predictor(HALF, paper))
    assert not np.allclose(bent.lane_offset_m, plain.lane_offset_m)
