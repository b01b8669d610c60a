"""Plausibility of a lane, by the own yaw rate."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from rendered_drive import CAMERA, Drive

from camera_synth.camera import projection
from plugin.lane import own_turn, refine
from plugin.lane.refine import Refine, init, step
from plugin.lane.road_model import KNOT, KNOTS, SPACING_M, STATES, TURN, curvature_at

NO_SLIP = Refine(rear_axle_m=0.0, rear_slip_s2pm=0.0)  # for cars that are moved along their heading
SPEED, PHASE, STD = 20.0, 6.0, 0.003


def row(phase=PHASE):
    """d yaw rate / d x."""
    H = np.zeros(STATES)
    H[TURN], H[KNOT], H[KNOT + 1] = 1.0, SPEED * (1.0 - phase / SPACING_M), SPEED * phase / SPACING_M
    return H


def belief(seed=0):
    rng = np.random.default_rng(seed)
    root = 0.05 * rng.standard_normal((STATES, STATES))
    return 0.01 * rng.standard_normal(STATES), root @ root.T + 1e-6 * np.eye(STATES)


def test_a_reading_is_the_textbook_kalman_update():
    x, P = belief()
    oracle = KalmanFilter(dim_x=STATES, dim_z=1)
    oracle.x, oracle.P = x.copy(), P.copy()
    oracle.update(0.05, R=STD**2, H=row()[None, :])
    own_turn.measure(x, P, PHASE, SPEED, 0.05, STD, np.zeros(STATES))
    assert x == pytest.approx(oracle.x, abs=1e-9)
    assert pytest.approx(oracle.P, abs=1e-9) == P


def test_a_start_expects_what_the_reading_says():
    x, P = belief()
    prior = np.linalg.inv(P)
    pull = prior @ x
    own_turn.expect(prior, pull, SPEED, 0.05, STD)
    own_turn.measure(x, P, 0.0, SPEED, 0.05, STD, np.zeros(STATES))
    assert np.linalg.solve(prior, pull) == pytest.approx(x, abs=1e-6)


def test_without_a_yaw_rate_nothing_changes():
    x, P = belief()
    before = x.copy(), P.copy()
    own_turn.measure(x, P, PHASE, SPEED, np.nan, STD, np.zeros(STATES))
    own_turn.expect(P, x, SPEED, np.nan, STD)
    np.testing.assert_array_equal(x, before[0])
    np.testing.assert_array_equal(P, before[1])
    assert own_turn.trust(x, PHASE, SPEED, np.nan, 0.02) == 1.0
    assert not own_turn.contradicted(x, PHASE, SPEED, np.nan, 0.0)


def test_a_lane_counts_less_the_more_the_car_would_turn_against_it():
    bend, x = np.array([0.0, 0.001, 0.002, 0.004]), np.zeros(STATES)
    trusted = []
    for curvature in bend:
        x[KNOT : KNOT + KNOTS] = curvature
        trusted.append(own_turn.trust(x, PHASE, SPEED, 0.0, 0.02))
    assert trusted == pytest.approx([1.0, 0.5, 0.2, 1.0 / 17.0])


def believed_after(yaw_rate):
    """(curvature under the wheels, yaw rate) that are believed after a second without lines, in cars that go
    straight on, the road under their wheels taken for a bend of 200 m before.
    """
    n, drive, p = 2, Drive(2, speed=SPEED), projection(CAMERA)
    state, given = init(n), None if yaw_rate is None else np.full(n, yaw_rate)
    for _ in range(15):
        drive.frame(np.zeros(n), np.zeros(n))
        state, _ = step(drive.frames, None, None, state, p, np.full(n, SPEED), NO_SLIP, None, given)
    assert refine.locked(state).all()
    state.x[:, KNOT : KNOT + KNOTS] = 0.005
    nothing = np.full_like(drive.frames, 90)
    for _ in range(10):
        state, _ = step(nothing, None, None, state, p, np.full(n, SPEED), NO_SLIP, None, given)
    here = np.array([curvature_at(x, phase, 0.0) for x, phase in zip(state.x, state.phase, strict=True)])
    return here, state.x[:, TURN] + SPEED * here


def test_while_no_line_is_seen_the_yaw_rate_corrects_the_road_under_the_wheels():
    assert believed_after(None)[0] == pytest.approx(0.005)
    here, yaw_rate = believed_after(0.0)
    assert (np.abs(here) < 0.003).all()
    assert (np.abs(yaw_rate) < 0.01).all()


def test_nan_is_the_camera_alone_to_the_bit():
    n, drive, p = 2, Drive(2), projection(CAMERA)
    one = other = init(n)
    for _ in range(6):
        drive.frame(np.zeros(n), np.zeros(n))
        one, _ = step(drive.frames, None, None, one, p, np.full(n, SPEED), NO_SLIP)
        other, _ = step(
            drive.frames, None, None, other, p, np.full(n, SPEED), NO_SLIP, None, np.full(n, np.nan)
        )
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)
