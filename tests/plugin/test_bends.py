"""Bends tighter than those of real roads: followed where seen, given up where not."""

import numpy as np
import pytest
from rendered_drive import CAMERA, Drive

from camera_synth.camera import projection
from plugin.lane import bends, lane_motion, refine
from plugin.lane.refine import Refine, init, step
from plugin.lane.road_model import KNOT, KNOTS, STATES, TURN

NO_SLIP = Refine(rear_axle_m=0.0, rear_slip_s2pm=0.0)  # for cars that are moved along their heading
T = refine.tuning(Refine(), 33.5)
WRONG_1PM = np.array([1.0, -1.0, 1.5, -1.5])[:, None] * np.array([0, 0, 0, 4, 5, 5, 5, 5, 5]) * 1e-3


def drive(frames, change=None, **road):
    """(frames, n) errors of the curvature at the preview; `change` is made to the state in mid-drive."""
    n, errors = 4, []
    seen = Drive(n, **road)
    state = init(n)
    for k in range(frames):
        truth = seen.frame(np.zeros(n), np.zeros(n))
        if change is not None and k == frames // 2:
            change(state)
        state, lane = step(
            seen.frames, None, None, state, projection(CAMERA), np.full(n, seen.speed), NO_SLIP
        )
        assert k < 5 or lane.locked.all()
        errors.append(lane.curvature_1pm - truth)
    return np.array(errors)


def test_a_bend_believed_for_long_is_given_up_where_it_is_not_seen():
    def bend(state):
        state.x[:, KNOT:TURN] = WRONG_1PM
        state.P[:, 0:KNOT, KNOT:TURN] = state.P[:, KNOT:TURN, 0:KNOT] = 0.0
        state.P[:, KNOT:TURN, KNOT:TURN] = 2e-4**2 * np.eye(KNOTS)

    errors = drive(44, bend, speed=15.0)
    assert np.abs(errors[25:]).max() < 2e-4


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_bend_that_is_seen_is_followed_however_odd(side):
    errors = drive(40, speed=12.0, curvature=-8e-3 * side, rate=2e-4 * side)
    assert np.sqrt(np.mean(errors[10:] ** 2)) < 5e-4


def test_a_road_leaves_its_course_where_it_bends_at_once():
    x = np.zeros(STATES)
    x[KNOT:TURN] = 1e-3
    assert bends.odd_bend(x, T) == KNOTS
    x[KNOT + 5 : TURN] = 4e-3
    assert bends.odd_bend(x, T) == 5


def test_streets_bend_more_than_motorways_and_a_jam_is_no_street():
    fast, street, crawling = (bends.bend_std(v, T) for v in (33.0, 14.0, 2.0))
    assert fast == T.bend_std_1pm
    assert street == crawling == pytest.approx(T.bend_std_mps2 / 14.0**2)
    assert street > 3.0 * fast


def test_a_road_forgotten_is_as_likely_as_a_road_goes_on():
    x, P = np.zeros(STATES), 1e-8 * np.eye(STATES)
    x[KNOT:TURN] = 1e-3, 1.5e-3, 9e-3, -9e-3, 0, 0, 0, 0, 0
    for j in range(2, KNOTS):
        lane_motion.extend(x, P, KNOT + j, T)
    assert bends.odd_bend(x, T) == KNOTS
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 0
    assert (np.diff(np.diag(P)[KNOT:TURN]) >= 0).all()
