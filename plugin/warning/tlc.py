"""Time to lane crossing (TLC): when a front wheel's outer edge meets a border on a predicted path."""

from typing import NamedTuple

import numpy as np

from plugin.motion.estimate import MotionEstimate, Trajectory
from plugin.warning import tlc_kernels
from sumo_net.arrays import Array
from sumo_net.vehicle import Vehicle


class Crossing(NamedTuple):
    """When and on which side the vehicle will leave its lane, (n,) each; NaN where unknown."""

    tlc_s: Array  # the first crossing; inf: none within the horizon; 0: a wheel is already over a border
    side: Array  # int8: +1 left, -1 right, 0 none
    left_s: Array  # of the left front wheel over the left border
    right_s: Array
    gap_left_m: Array  # now, left front wheel's outer edge to the left border, negative beyond it
    gap_right_m: Array


def time_to_lane_crossing(
    motion: MotionEstimate,
    path: Trajectory,
    step_s: float,
    vehicle: Vehicle,
    half_span_m: Array | None = None,
) -> Crossing:
    """TLC of n vehicles on their predicted paths (n, H), whose points are step_s apart.

    The wheel's edge lies l_f ahead of the centre of gravity and half_span_m (n,) aside (default: half of the
    vehicle's wheel span); between two points of the path it moves linearly. The path decides the method:
    predicted, constant velocity, constant radius.
    """
    n = len(motion.lateral_offset_m)
    half_span = np.full(n, 0.5 * vehicle.wheel_span_m) if half_span_m is None else half_span_m
    floats = [np.empty(n) for _ in range(5)]
    out = Crossing(floats[0], np.zeros(n, np.int8), *floats[1:])
    tlc_kernels.crossing(motion, path, vehicle.front_axle_m, half_span, step_s, out)
    return out
