"""Data types of the observers and the predictor; left positive, ISO 8855."""

from typing import NamedTuple

import numpy as np

from sumo_net.arrays import Array


class MotionEstimate(NamedTuple):
    """The vehicle's lateral motion as observed, (n,) each; NaN where unknown."""

    lateral_speed_mps: Array  # v_y at the centre of gravity
    yaw_rate_rps: Array  # γ
    steer_rad: Array  # δ_D, front wheels
    quick_steer_rad: Array  # the part of it that is fast jitter (hands, road) and will not last; NaN: unknown
    lateral_offset_m: Array  # filtered offset of the centre of gravity left of the lane centre
    heading_error_rad: Array  # filtered vehicle heading minus lane heading at the centre of gravity
    curvature_1pm: Array  # filtered lane curvature at the centre of gravity
    curvature_rate_1pm2: Array
    lane_width_m: Array  # filtered, known also while the observer coasts over frames without a lane
    settled_s: Array  # time since the start, a lane estimate that contradicted, or a longer time without one
    lane_shift: Array  # int8: +1 the offset refers to the lane on the left of the step before, -1 right


class OwnReadings(NamedTuple):
    """Readings of the vehicle's own sensors besides speed, (n,) each, left positive; NaN for none."""

    yaw_rate_rps: Array  # gyroscope
    steer_rad: Array  # front wheels, from the steering wheel's angle


def no_readings(n: int) -> OwnReadings:
    """OwnReadings of n vehicles without own sensors."""
    return OwnReadings(np.full(n, np.nan), np.full(n, np.nan))


def blank(n: int) -> MotionEstimate:
    """A MotionEstimate of n vehicles to be filled."""
    parts = [np.empty(n) for _ in MotionEstimate._fields[:-1]]
    return MotionEstimate._make([*parts, np.zeros(n, np.int8)])


class Trajectory(NamedTuple):
    """A predicted path in the present vehicle frame: H times, the first one step ahead; (n, H) each."""

    forward_m: Array
    left_m: Array
    heading_rad: Array
    lane_offset_m: Array  # centre of gravity left of the centre of the present lane
    lane_heading_rad: Array  # vehicle heading minus lane heading
