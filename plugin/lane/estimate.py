"""Results of lane detection: borders in the image, and the lane in the vehicle frame."""

from typing import NamedTuple

import numpy as np

from sumo_net.arrays import Array

ROWS, ROW_STEP = 50, 3
BORDER_Y = 1.0 + ROW_STEP * np.arange(ROWS)  # where borders are reported: 1 to 148, as the published blocks


class Borders(NamedTuple):
    """The two borders of the ego lane in the image, x = a·y² + b·y + c (eq. 1), for n vehicles."""

    left: Array  # (n, 3) a, b, c
    right: Array  # (n, 3)
    score: Array  # (n, 2) objective F of left and right (eqs. 2, 3)


class LaneEstimate(NamedTuple):
    """The ego lane as detected by the camera, (n,) each. Left positive; NaN where `locked` is False."""

    locked: Array  # bool
    score: Array  # 0 (nothing seen) to 1 (as much as expected)
    lateral_offset_m: Array  # vehicle's centre of gravity left of the lane centre
    heading_error_rad: Array  # vehicle heading minus lane heading, at the centre of gravity
    curvature_1pm: Array  # lane curvature at the preview point, K_L
    curvature_rate_1pm2: Array  # its change along the lane (0 in paper mode)
    lane_width_m: Array
    preview_offset_m: Array  # y_L: lane centre left of the vehicle's axis at the preview distance
    preview_heading_rad: Array  # e_L: lane heading minus vehicle heading there
    left_border_seen: Array  # bool: measured in this frame, not only predicted
    right_border_seen: Array  # bool
    left_unseen_m: Array  # driven since paint of that border was seen nearby; also while not locked
    right_unseen_m: Array
    lane_shift: Array  # int8: +1 the estimate moved to the lane on the left since the last step, -1 right


def blank(n: int) -> LaneEstimate:
    """A LaneEstimate of n vehicles to be filled."""
    kinds = dict.fromkeys(("locked", "left_border_seen", "right_border_seen"), np.bool_)
    parts = {name: np.empty(n, kinds.get(name, np.float64)) for name in LaneEstimate._fields}
    return LaneEstimate(**parts | {"lane_shift": np.empty(n, np.int8)})
