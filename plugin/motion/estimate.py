"""What the observers and the predictor hand on, left positive, ISO 8855."""

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]


class MotionEstimate(NamedTuple):
    """The vehicle's lateral motion as observed from the camera, (n,) each; NaN where nothing is known."""

    lateral_speed_mps: Array  # v_y at the centre of gravity
    yaw_rate_rps: Array  # γ
    steer_rad: Array  # δ_D, front wheels
    quick_steer_rad: Array  # part of it that is unrest of hands and road and will not last; NaN: not known
    lateral_offset_m: Array  # filtered offset of the centre of gravity left of the lane centre
    heading_error_rad: Array  # filtered vehicle heading minus lane heading at the centre of gravity
    curvature_1pm: Array  # filtered lane curvature at the centre of gravity
    curvature_rate_1pm2: Array
    lane_width_m: Array  # filtered, known also while the observer coasts over frames without a lane
    settled_s: Array  # since it began anew, or was contradicted by a look, or had none for long
    lane_shift: Array  # int8: +1 the offset refers to the lane on the left of the step before, -1 right


class OwnReadings(NamedTuple):
    """What the vehicle's own sensors say beside its speed, (n,) each, left positive; NaN for none."""

    yaw_rate_rps: Array  # gyroscope
    steer_rad: Array  # front wheels, by the steering wheel's angle


def no_readings(n: int) -> OwnReadings:
    """n vehicles of which the camera is all that is known."""
    return OwnReadings(np.full(n, np.nan), np.full(n, np.nan))


def blank(n: int) -> MotionEstimate:
    """A MotionEstimate of n vehicles to be written into."""
    parts = [np.empty(n) for _ in MotionEstimate._fields[:-1]]
    return MotionEstimate._make([*parts, np.zeros(n, np.int8)])


class Trajectory(NamedTuple):
    """A predicted path in the vehicle frame of now: H times, the first one step ahead; (n, H) each."""

    forward_m: Array
    left_m: Array
    heading_rad: Array
    lane_offset_m: Array  # centre of gravity left of the centre of the lane of now
    lane_heading_rad: Array  # vehicle heading minus lane heading
