"""The lane found from nothing in one frame."""

import numpy as np
import pytest
from drawn_road import draw

from camera_synth.camera import Camera, projection
from plugin.lane import refine
from plugin.lane.evidence import most_support, support_of
from plugin.lane.follow import Frame
from plugin.lane.hidden import nothing_hidden
from plugin.lane.lane_start import Given, room_for, start
from plugin.lane.refine_fit import workspace
from plugin.lane.road_model import HEADING, OFFSET, STATES, rows_to_read

CAMERA = Camera()
ROWS = rows_to_read(CAMERA.horizon_y_px)
NONE = np.zeros(3)
TUNING = refine.tuning(refine.Refine(), CAMERA.preview_m)


def found(frame, least, followed=None):
    """Support, x, P, the workspace of the look and how many arcs the vote proposed."""
    work, x, P = workspace(len(ROWS)), np.zeros(STATES), np.zeros((STATES, STATES))
    work.hidden[:] = nothing_hidden(1)[0]
    p, room = projection(CAMERA), room_for(len(ROWS))
    followed = room.nowhere if followed is None else followed
    seen, unknown = Frame(frame, 25.0, np.nan), Given(np.bool_(False), NONE, NONE)
    support = start(seen, unknown, 0.0, least, followed, ROWS, p, TUNING, work, room, x, P)
    return support, x, P, work, np.count_nonzero(room.score)


@pytest.mark.parametrize("dash_m", [None, 6.0])
def test_what_must_be_exceeded_changes_no_lane_that_does(dash_m):
    frame = draw((2.1, -1.5), slope=0.01, curvature=0.001, dash_m=dash_m)
    support, x, P, work, _ = found(frame, 0)
    assert abs(x[OFFSET] + 0.3) < 0.05
    assert abs(x[HEADING] + 0.01) < 0.006
    assert support == support_of(x, TUNING, work) <= most_support(work)
    for least in (1, support // 2, support - 1):
        again, x_again, P_again, *_ = found(frame, least)
        assert again == support
        np.testing.assert_array_equal(x_again, x)
        np.testing.assert_array_equal(P_again, P)
    assert found(frame, support)[0] == 0
    assert found(frame, 2 * len(ROWS))[0] == 0


def test_no_other_lane_is_sought_where_the_best_vote_leads_to_the_one_followed():
    frame = draw((2.1, -1.5), slope=0.01, curvature=0.001)
    support, x, _, _, tried = found(frame, 0)
    assert tried > 1
    again, x_again, _, _, tried = found(frame, 0, x)
    assert tried == 1
    assert abs(again - support) <= 4
    assert np.abs(x_again - x).max() < 0.01
    elsewhere = x.copy()
    elsewhere[OFFSET] += 1.0
    again, x_again, _, _, tried = found(frame, 0, elsewhere)
    assert tried > 1
    np.testing.assert_array_equal(x_again, x)
