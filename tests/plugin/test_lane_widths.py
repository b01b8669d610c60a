"""Lanes that are narrower or wider than usual ones."""

import numpy as np
import pytest
from drawn_road import draw

from camera_synth.camera import Camera, projection
from plugin.lane.refine import Refine, init, step

SPEED, FRAMES = 14.0, 20
NO_SLIP = Refine(rear_axle_m=0.0, rear_slip_s2pm=0.0)  # for cars that are moved along their heading


def driven(solid, dashed, offset_m=0.1):
    """Estimates of FRAMES frames beside lines at left = … from the lane's centre."""
    state, p, lanes = init(1), projection(Camera()), []
    for k in range(FRAMES):
        frame = draw([at - offset_m for at in solid], noise=3.0, seed=k)
        inner = draw(
            [at - offset_m for at in dashed], dash_m=3.0, phase_m=0.1 * SPEED * k, noise=3.0, seed=k + 100
        )
        frames = np.maximum(frame, inner)[None]
        state, lane = step(frames, None, None, state, p, np.full(1, SPEED), NO_SLIP, None, np.zeros(1))
        lanes.append(lane)
    return lanes


@pytest.mark.parametrize(
    ("solid", "dashed", "width_m"),
    [
        ((-0.95, 4.15), (0.95,), 1.9),  # beside a lane of 3.2 m
        ((-1.2, 9.7), (1.2, 6.7), 2.4),  # beside one of 5.5 m and one of 3 m
        ((-4.15,), (-2.75, 2.75, 5.75), 5.5),
        ((-4.0, 12.0), (4.0,), 8.0),  # the only one of its direction
        ((-1.8,), (1.8, 5.4, 9.0), 3.6),
        ((-1.8, 5.4), (1.8,), 3.6),  # two of 3.6 m are not one of 7.2 m
    ],
)
def test_the_lane_is_the_one_between_its_own_lines(solid, dashed, width_m):
    lanes = driven(solid, dashed)
    assert np.mean([lane.locked[0] for lane in lanes]) > 0.7
    for lane in lanes[5:]:
        if lane.locked[0]:
            assert lane.lane_width_m[0] == pytest.approx(width_m, abs=0.15)
            assert lane.lateral_offset_m[0] == pytest.approx(0.1, abs=0.1)


def test_lanes_wider_than_the_vote_looks_are_refused():
    with pytest.raises(ValueError, match="max_width_m"):
        Refine(max_width_m=40.0)  # lines within such a lane would be counted outside of the votes' memory


@pytest.mark.parametrize("width_m", [3.75, 5.0])
def test_what_is_beside_the_road_is_no_lane_to_go_over_to(width_m):
    state, p, shifts = init(1), projection(Camera()), 0
    offsets = np.concatenate([np.linspace(0.0, 2.6, 70), np.full(5, 2.6)])
    for k, offset_m in enumerate(offsets):
        solid = np.array([-1.875, 1.875, 1.875 + width_m]) - offset_m
        frames = draw(solid, noise=3.0, seed=k)[None]
        state, lane = step(frames, None, None, state, p, np.full(1, SPEED), NO_SLIP, None, np.zeros(1))
        shifts += int(lane.lane_shift[0])
    assert shifts == (1 if width_m == 3.75 else 0)
