"""Kernel of what the estimates of a step are compared with."""

import math

import numpy as np

from plugin.motion.estimate import MotionEstimate, Trajectory
from plugin.motion.prediction_kernels import constant_radius, constant_velocity, single_track
from plugin.warning.tlc import Crossing
from plugin.warning.tlc_kernels import crossing
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_vector


@kernel
def _points(path, horizon, out):  # type: ignore[no-untyped-def]
    """out (n, 4, 3) <- forward, left, heading of the path's points `horizon` (4,); NaN beyond its end."""
    for i in range(out.shape[0]):
        for k in range(len(horizon)):
            if horizon[k] < path.forward_m.shape[1]:
                out[i, k, 0] = path.forward_m[i, horizon[k]]
                out[i, k, 1] = path.left_m[i, horizon[k]]
                out[i, k, 2] = path.heading_rad[i, horizon[k]]
            else:
                out[i, k] = math.nan


@kernel
def _true_motion(truth, rate):  # type: ignore[no-untyped-def]
    """The estimate of an observer without error; rate (n,) is the change of curvature."""
    n = len(rate)
    return MotionEstimate(
        truth.lateral_speed_mps,
        truth.yaw_rate_rps,
        truth.steer_rad,
        np.full(n, math.nan),
        truth.lane_offset_m,
        truth.lane_heading_rad,
        truth.curvature_1pm,
        rate,
        truth.lane_width_m,
        np.full(n, math.inf),
        np.zeros(n, np.int8),
    )


@kernel
def _judge(k, way, motion, half_span, front_axle, step, horizon, cross, out):  # type: ignore[no-untyped-def]
    """Write points of the path `way` to out.points[k + 1], its time to lane crossing to out.tlc_s[k]."""
    crossing(motion, way, front_axle, half_span, step, cross)
    copy_vector(cross.tlc_s, out.tlc_s[k])
    _points(way, horizon, out.points[k + 1])


@kernel
def compare(truth, curvature, motion, speed, path, half_span, q, front_axle, preview, at, horizon, out):  # type: ignore[no-untyped-def]
    """Fill Reference `out` of n vehicles; see ground_truth.Judge.reference.

    curvature (n, J) : of the road at AHEAD_M. preview : m; at : index of the next of AHEAD_M, and how far
    it is along the way from the one before. q : the Predictor. horizon (4,) : points of a path.
    """
    n, (later, share) = len(speed), at
    rate = np.empty(n)
    for i in range(n):
        before = curvature[i, later - 1]
        out.curvature_1pm[i] = before + share * (curvature[i, later] - before)
        rate[i] = (out.curvature_1pm[i] - truth.curvature_1pm[i]) / preview
        if math.isnan(rate[i]):  # the road ends before
            rate[i] = 0.0
        sine, cosine = math.sin(truth.lane_heading_rad[i]), math.cos(truth.lane_heading_rad[i])
        out.drift_mps[i] = truth.speed_mps[i] * sine + truth.lateral_speed_mps[i] * cosine
        axle, reach = truth.lane_offset_m[i] + front_axle * sine, half_span[i] * cosine
        left = 0.5 * truth.lane_width_m[i] - axle - reach
        right = 0.5 * truth.lane_width_m[i] + axle - reach
        out.margin_left_m[i] = left if truth.border_kind_left[i] > 0 else math.nan
        out.margin_right_m[i] = right if truth.border_kind_right[i] > 0 else math.nan
    _points(path, horizon, out.points[0])
    f, c = np.empty((5, n, q.steps)), np.empty((5, n))
    way = Trajectory(f[0], f[1], f[2], f[3], f[4])
    cross = Crossing(c[0], np.empty(n, np.int8), c[1], c[2], c[3], c[4])
    constant_velocity(motion, speed, q, way)
    _judge(0, way, motion, half_span, front_axle, q.step_s, horizon, cross, out)
    constant_radius(motion, speed, q, way)
    _judge(1, way, motion, half_span, front_axle, q.step_s, horizon, cross, out)
    actual = _true_motion(truth, rate)
    single_track(actual, truth.speed_mps, q, way)
    _judge(2, way, actual, half_span, front_axle, q.step_s, horizon, cross, out)
