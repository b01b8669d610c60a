"""A newly found lane that competes with the one being followed."""

import numpy as np
import pytest
from rendered_drive import CAMERA, Drive

from camera_synth.camera import projection
from plugin.lane import refine, rival
from plugin.lane.refine import Refine, init, step
from plugin.lane.road_model import HEADING, OFFSET, STATES, WIDTH

T = refine.tuning(Refine(), CAMERA.preview_m)
NO_SLIP = Refine(rear_axle_m=0.0, rear_slip_s2pm=0.0)  # for cars that are moved along their heading
TURNED_RAD, ASIDE_M = 0.05, -1.3


def pose(offset, heading=0.0, width=3.75):
    x = np.zeros(STATES)
    x[OFFSET], x[HEADING], x[WIDTH] = offset, heading, width
    return x


@pytest.mark.parametrize(
    ("followed", "fresh", "wanted"),
    [
        (pose(0.3, 0.01), pose(0.4, 0.015), False),
        (pose(1.9), pose(-1.85), False),  # the same place, taken for the lane on the left
        (pose(-1.9), pose(1.85), False),
        (pose(0.36, 0.045), pose(-1.55, -0.015, 4.48), True),  # seen in a lane change
        (pose(0.0), pose(0.0, 0.05), True),
        (pose(0.0), pose(0.0, 0.0, 4.4), True),
        (pose(0.0), pose(1.9), True),
    ],
)
def test_what_contradicts_a_prediction(followed, fresh, wanted):
    assert rival.contradicts(fresh, followed, 1e-6 * np.eye(STATES), T) is wanted
    assert not rival.contradicts(fresh, followed, np.eye(STATES), T)  # no contradiction without knowledge


def test_a_rival_must_be_the_same_lane_in_one_look_after_the_other():
    one, x = np.zeros(rival.RIVAL), pose(0.0)
    aside, proven = -1.3, []
    for _ in range(T.rival_looks):
        rival.carry(one, 2.5)
        proven.append(rival.prove(one, pose(aside, TURNED_RAD), x, T.rival_looks, T))
        aside += 2.5 * TURNED_RAD
    assert proven == [False] * (T.rival_looks - 1) + [True]
    assert not rival.prove(one, pose(aside + 1.0, TURNED_RAD), x, T.rival_looks, T)
    assert one[rival.LOOKS] == 1.0


def estimates(elsewhere_frames, frames, first=30):
    """(frames, 3, 2) offset and heading of 3 cars in mid-lane whose cameras then show another pose: from
    frame `first` on, for so long."""
    n, drive = 3, Drive(3)
    state, rows = init(n), []
    for k in range(frames):
        out = first <= k < first + elsewhere_frames
        heading = TURNED_RAD if out else 0.0
        offset = ASIDE_M + drive.speed * 0.1 * (k - first) * TURNED_RAD if out else 0.0
        drive.frame(np.full(n, offset), np.full(n, heading))
        state, lane = step(
            drive.frames, None, None, state, projection(CAMERA), np.full(n, drive.speed), NO_SLIP
        )
        rows.append(np.stack([lane.lateral_offset_m, lane.heading_error_rad], axis=-1))
    return np.array(rows)


def test_lines_elsewhere_for_a_moment_are_not_believed():
    rows = estimates(elsewhere_frames=4, frames=45)
    assert np.abs(rows[30:34, :, 0]).max() < 0.2
    assert np.abs(rows[30:34, :, 1]).max() < 0.5 * TURNED_RAD  # nearer to what it was
    assert np.abs(rows[36:, :, 0]).max() < 0.05


def test_a_lane_followed_for_a_moment_is_believed_against_one_look():
    rows = estimates(elsewhere_frames=3, frames=20, first=8)
    assert np.abs(rows[8:11, :, 0]).max() < 0.2
    assert np.abs(rows[13:, :, 0]).max() < 0.05


def test_lines_that_stay_elsewhere_are_believed():
    rows = estimates(elsewhere_frames=20, frames=50)
    there = ASIDE_M + 2.5 * TURNED_RAD * np.arange(20)
    assert np.abs(rows[42:50, :, 0] - there[12:, None]).max() < 0.1
    assert np.abs(rows[42:50, :, 1] - TURNED_RAD).max() < 0.005
