"""Kernel of the observer bank of Zhang et al. 2011, section 3, over the fleet."""

import math
from typing import NamedTuple

import numpy as np

from plugin.motion.steering_kernels import front_steer
from sumo_net.arrays import Array
from sumo_net.compile import kernel


class BankSchedule(NamedTuple):
    """Everything of the bank that is computed at set-up; m observers, one every 10 km/h from 0."""

    transition: Array  # (m, 4, 4) Φ
    input: Array  # (m, 4, 2) G
    gain: Array  # (m, 4, 2) steady-state K of (v_y, γ, y_L, e_L) on (y_L, e_L)
    spacing_mps: float  # between two observers
    understeer_s2pm: float
    wheelbase_m: float
    preview_m: float
    step_s: float
    coast_s: float
    low_mps: float  # begin of the handover from the kinematic to the dynamic steer
    high_mps: float  # its end


class BankState(NamedTuple):
    """The two observers around each vehicle's speed, and the state of the steering estimate."""

    running: Array  # (n,) bool: False until the lane has been seen
    below: Array  # (n,) int32: index of the lower observer
    lower: Array  # (n, 4) v_y, γ, y_L, e_L
    upper: Array  # (n, 4)
    steer: Array  # (n,) δ_D, held while coasting
    curvature: Array  # (n,) K_L, held while coasting
    width: Array  # (n,)
    heading: Array  # (n,) e_L as last measured
    unseen: Array  # (n,) s since the lane was last seen
    settled: Array  # (n,) s since the start


@kernel
def observe(x, j, s, steer, curvature, seen, y, e, out):  # type: ignore[no-untyped-def]
    """One step of observer j (eqs. 15 and 18) from the previous state x (4,) to the new state out (4,)."""
    for r in range(4):
        out[r] = s.input[j, r, 0] * steer + s.input[j, r, 1] * curvature
        for c in range(4):
            out[r] += s.transition[j, r, c] * x[c]
    if seen:
        dy, de = y - out[2], e - out[3]
        for r in range(4):
            out[r] += s.gain[j, r, 0] * dy + s.gain[j, r, 1] * de


@kernel
def step(state, s, lane, speed, new, out):  # type: ignore[no-untyped-def]
    """One step for n vehicles; the new BankState into `new`, a MotionEstimate into `out`."""
    last = s.gain.shape[0] - 1
    first, second = np.empty(4), np.empty(4)
    for i in range(speed.size):
        v = max(0.0, speed[i])
        y, e = lane.preview_offset_m[i], lane.preview_heading_rad[i]
        seen = lane.locked[i] and math.isfinite(y + e + lane.curvature_1pm[i])
        unseen = 0.0 if seen else state.unseen[i] + s.step_s
        running = math.isfinite(v) and (seen or (state.running[i] and unseen <= s.coast_s + 1e-9))
        new.running[i], new.unseen[i] = running, unseen
        if not running:
            forget(i, new, out)
            continue

        at = min(v / s.spacing_mps, last - 1e-9)
        j = int(at)
        width, shift = state.width[i], lane.lane_shift[i]
        curvature, steer, before = state.curvature[i], state.steer[i], state.heading[i]
        if seen:
            curvature, width = lane.curvature_1pm[i], lane.lane_width_m[i]
            if state.running[i] and state.unseen[i] == 0.0:
                steer = front_steer(
                    curvature, e, before, v, s.understeer_s2pm, s.wheelbase_m, s.step_s, s.low_mps, s.high_mps
                )
            before = e

        if not state.running[i]:
            shift = 0  # no earlier lane to refer to; the car is assumed to follow the road
            steer = front_steer(
                curvature, e, e, v, s.understeer_s2pm, s.wheelbase_m, s.step_s, s.low_mps, s.high_mps
            )
            new.lower[i, 0], new.lower[i, 1] = 0.0, v * curvature
            new.lower[i, 2], new.lower[i, 3] = y, e
            for r in range(4):
                new.upper[i, r] = new.lower[i, r]
        else:
            k = state.below[i]
            for r in range(4):  # a new observer starts from the one that remains
                first[r] = state.lower[i, r] if j <= k else state.upper[i, r]
                second[r] = state.upper[i, r] if j >= k else state.lower[i, r]
            first[2] += shift * width
            second[2] += shift * width
            observe(first, j, s, steer, curvature, seen, y, e, new.lower[i])
            observe(second, j + 1, s, steer, curvature, seen, y, e, new.upper[i])
        settled = 0.0
        if state.running[i]:
            settled = state.settled[i] + s.step_s
        new.settled[i] = out.settled_s[i] = settled
        new.below[i], new.steer[i], new.curvature[i] = j, steer, curvature
        new.width[i], new.heading[i] = width, before

        w = at - j
        offset = w * new.upper[i, 2] + (1.0 - w) * new.lower[i, 2]
        heading = w * new.upper[i, 3] + (1.0 - w) * new.lower[i, 3]
        out.lateral_speed_mps[i] = w * new.upper[i, 0] + (1.0 - w) * new.lower[i, 0]  # eq. 22, corrected
        out.yaw_rate_rps[i] = w * new.upper[i, 1] + (1.0 - w) * new.lower[i, 1]
        out.steer_rad[i], out.quick_steer_rad[i] = steer, 0.0
        out.lateral_offset_m[i] = -offset + heading * s.preview_m - 0.5 * curvature * s.preview_m**2
        out.heading_error_rad[i] = curvature * s.preview_m - heading
        out.curvature_1pm[i], out.curvature_rate_1pm2[i] = curvature, 0.0
        out.lane_width_m[i], out.lane_shift[i] = width, shift


@kernel
def forget(i, new, out):  # type: ignore[no-untyped-def]
    """Nothing is known of vehicle i: NaN in the estimate, an initial state."""
    new.below[i] = 0
    for r in range(4):
        new.lower[i, r] = new.upper[i, r] = 0.0
    new.steer[i] = new.curvature[i] = new.heading[i] = new.settled[i] = 0.0
    new.width[i] = math.nan
    out.lateral_speed_mps[i] = out.yaw_rate_rps[i] = out.steer_rad[i] = math.nan
    out.quick_steer_rad[i], out.settled_s[i] = math.nan, 0.0
    out.lateral_offset_m[i] = out.heading_error_rad[i] = math.nan
    out.curvature_1pm[i] = out.curvature_rate_1pm2[i] = out.lane_width_m[i] = math.nan
    out.lane_shift[i] = 0
