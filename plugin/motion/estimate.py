"""What the observers and the predictor hand on, left positive, ISO 8855."""

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]


class MotionEstimate(NamedTuple):
    """The vehicle's lateral motion as observed from the camera, (n,) each; NaN where nothing is known."""

    lateral_speed_mps: Array  # v_y at the centre of gravity
    yaw_rate_rps: Array  # γ
    steer_rad: Array  # δ_D, front wheels
    lateral_offset_m: Array  # filtered offset of the centre of gravity left of the lane centre
    heading_error_rad: Array  # filtered vehicle heading minus lane heading at the centre of gravity
    curvature_1pm: Array  # filtered lane curvature at the centre of gravity
    curvature_rate_1pm2: Array


class Trajectory(NamedTuple):
    """A predicted path in the vehicle frame of now: H times, the first one step ahead; (n, H) each."""

    forward_m: Array
    left_m: Array
    heading_rad: Array
    lane_offset_m: Array  # centre of gravity left of the centre of the lane of now
    lane_heading_rad: Array  # vehicle heading minus lane heading
