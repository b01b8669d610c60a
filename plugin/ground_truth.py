"""What the truth would read like if the vehicle's own chain had found it: the scorer's reference."""

import functools
from typing import Any

import numpy as np

from plugin.motion.estimate import MotionEstimate
from sumo_net.ego import EgoTruth
from sumo_net.road import AHEAD_M, RoadAhead

Array = np.ndarray[Any, Any]


def curvature_ahead(ahead: RoadAhead, distance_m: float) -> Array:
    """(n,) curvature of the path so far ahead of the centre of gravity; NaN where the path ends before."""
    j, part = _between(distance_m)
    before, after = ahead.curvature_1pm[:, j - 1], ahead.curvature_1pm[:, j]
    return np.asarray(before + part * (after - before))


@functools.cache
def _between(distance_m: float) -> tuple[int, float]:
    """Which of AHEAD_M comes next, and how much of the way to it from the one before."""
    j = min(max(int(np.searchsorted(AHEAD_M, distance_m)), 1), len(AHEAD_M) - 1)
    return j, float((distance_m - AHEAD_M[j - 1]) / (AHEAD_M[j] - AHEAD_M[j - 1]))


def true_motion(truth: EgoTruth, ahead: RoadAhead, preview_m: float) -> MotionEstimate:
    """The state that an errorless observer would hand on, (n,) each.

    Its change of curvature is the mean one up to the preview point, 0 where the road ends before.
    """
    rate = (curvature_ahead(ahead, preview_m) - truth.curvature_1pm) / preview_m
    return MotionEstimate(
        lateral_speed_mps=truth.lateral_speed_mps,
        yaw_rate_rps=truth.yaw_rate_rps,
        steer_rad=truth.steer_rad,
        quick_steer_rad=np.full(len(truth.handle), np.nan),
        lateral_offset_m=truth.lane_offset_m,
        heading_error_rad=truth.lane_heading_rad,
        curvature_1pm=truth.curvature_1pm,
        curvature_rate_1pm2=np.where(np.isnan(rate), 0.0, rate),
        lane_width_m=truth.lane_width_m,
        settled_s=np.full(len(truth.handle), np.inf),
        lane_shift=np.zeros(len(truth.handle), np.int8),
    )


def margins(truth: EgoTruth, front_axle_m: float, half_span_m: Array) -> tuple[Array, Array]:
    """From the front wheels' outer edges to the left and right border, (n,) each in m, positive inside.

    NaN towards a border that is not painted.
    """
    axle = truth.lane_offset_m + front_axle_m * np.sin(truth.lane_heading_rad)
    reach = half_span_m * np.cos(truth.lane_heading_rad)
    left = 0.5 * truth.lane_width_m - axle - reach
    right = 0.5 * truth.lane_width_m + axle - reach
    return np.where(truth.border_kind_left > 0, left, np.nan), np.where(
        truth.border_kind_right > 0, right, np.nan
    )
