"""Kernel of the motion filter over the fleet: a Kalman filter of thirteen states per vehicle.

x = (v_y, γ, d, ψ, K, K', r, q, u, w, b, g, o): lateral speed and yaw rate; offset and heading to the lane;
the lane's curvature at the vehicle and its change along the lane; r, the lateral acceleration that the driver
steers for beyond the road's, and q, its target value behind the lag of the arms; u, a noise, and w, its
low-pass part, whose difference u − w is the fast steering jitter; b, the slowly varying error of the camera's
heading; g and o, the offsets of gyroscope and steering sensor. Without these sensors g and o stay
uncorrelated with the rest, which then depends on the camera alone.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_net.arrays import Array
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_matrix, copy_vector

N = 13  # states
M = 4  # measurements of a look, the lane estimate of one frame
VY, YAW, D, PSI, K, KRATE, R, AIM, UNREST, CALM, BIAS, GYRO, ALIGNMENT = range(N)
_HARDEST_MPS2 = 3.0  # lateral acceleration up to which the process noise grows with it
_REOPENED = (VY, YAW, PSI, R, AIM)  # states whose variance an abrupt manoeuvre raises
_REOPENED_SENSED = (D, PSI, K, KRATE)  # the same with own sensors, which measure the motion
_REOPENED_BY_YAW_RATE, _REOPENED_BY_STEER = (VY, YAW), (R, AIM)
# standard deviations by state: m/s, rad/s, m, rad, 1/m, 1/m², m/s², m/s²
_REOPENED_SD = (0.3, 0.1, 0.05, 0.01, 3e-4, 1e-5, 2.0, 2.0)
_GROSS = 2.0  # multiple of the clip beyond which an innovation is a gross one


class FilterSchedule(NamedTuple):
    """Everything of the filter that is computed at set-up; m speeds from 0, equally spaced."""

    transition: Array  # (m, 13, 13) Φ
    noise: Array  # (m, 13, 13) Q
    steer: Array  # (m, 3) δ_D = steer · (K, K', r)
    steady: Array  # (m, 2) (v_y, γ) in a steady turn, for curvature 1
    initial: Array  # (13,) variances after the first look
    whitened: Array  # (4, 13) W H: measurements (d, ψ, mean K, K') of unit variance, uncorrelated
    whitener: Array  # (4, 4) W
    quick: float  # rad per unit of UNREST − CALM
    slip_error: float  # √s, error of the model's v̇_y as a share of v γ
    liveliness: float  # 1/√s, growth of AIM's noise with the residual
    spacing: float  # m/s between two speeds
    preview: float
    step: float
    coast_s: float
    settle_s: float
    doubt_sd: float  # standard deviations from which on an innovation contradicts the estimate
    clip_sd: float  # standard deviations at which innovations are clipped
    misfit_m: float  # offset innovation from which on a look is a misfit, whatever the covariance
    misfit_looks: int  # more misfits in a row than this restart the filter
    one_border_factor: float  # on the standard deviations while only one border is seen
    width_share: float
    yaw_rate_noise: float  # variance of a reading of the gyroscope
    steer_noise: float  # variance of a reading of the front wheels' steer, at speed
    steer_scale: float  # further error of the reading, as a share of the steer
    slow_mps: float  # below which the steer is trusted less and less
    sensed_look_factor: float  # on those of offset and heading while both sensors read
    sensed_slip_error: float  # replaces slip_error then


class FilterState(NamedTuple):
    """The filter state of n vehicles."""

    running: Array  # (n,) bool
    x: Array  # (n, 13)
    P: Array  # (n, 13, 13)
    width: Array  # (n,)
    unseen: Array  # (n,) s since the lane was last seen
    age: Array  # (n,) s since the filter started
    misfits: Array  # (n,) int32 misfits in a row
    settled: Array  # (n,) s since the start or since a look last contradicted the state


@kernel
def step(state, s, lane, own, speed, new, out):  # type: ignore[no-untyped-def]
    """One step for n vehicles; the new FilterState into `new`, a MotionEstimate into `out`.

    `own` (OwnReadings): the vehicles' own sensors, NaN where there are none.
    """
    F, Q, half = np.empty((N, N)), np.empty((N, N)), np.empty((N, N))
    z, gain, PH = np.empty(M), np.empty(N), np.empty(N)
    x_before, P_before = np.empty(N), np.empty((N, N))
    for i in range(speed.size):
        v = max(0.0, speed[i])
        z[0], z[1] = lane.lateral_offset_m[i], lane.heading_error_rad[i]
        # The mean curvature up to the preview point is (e_L + ψ) / D_L. It holds for the road that is driven
        # next even where a change of curvature begins or ends in view; extrapolated back from K_L it would
        # not. K' in front of the vehicle is better known from it than from the tracker's own, which reaches
        # further.
        mean = (lane.preview_heading_rad[i] + z[1]) / s.preview
        z[2] = mean
        z[3] = 2.0 * (lane.curvature_1pm[i] - mean) / s.preview
        borders = int(lane.left_border_seen[i]) + int(lane.right_border_seen[i])
        seen = lane.locked[i] and borders > 0 and math.isfinite(z[0] + z[1] + z[2] + z[3])
        unseen = 0.0 if seen else state.unseen[i] + s.step
        running = state.running[i] and unseen <= s.coast_s + 1e-9 and math.isfinite(v)
        if not running and not (seen and math.isfinite(v)):
            forget(i, state, new, out)
            continue

        at = min(v / s.spacing, s.steer.shape[0] - 1 - 1e-9)
        j = int(at)
        w = at - j
        x, P = new.x[i], new.P[i]
        yaw_rate, steer = own.yaw_rate_rps[i], own.steer_rad[i]
        sensed = math.isfinite(yaw_rate + steer)
        shift, misfits, age, settled = 0, 0, 0.0, 0.0
        width = lane.lane_width_m[i] if seen else state.width[i]
        if running:
            age, misfits = state.age[i] + s.step, state.misfits[i]
            settled = state.settled[i] + s.step
            if math.isfinite(state.width[i]):
                width = state.width[i]
                if seen and math.isfinite(lane.lane_width_m[i]):
                    width += s.width_share * (lane.lane_width_m[i] - width)
            predict(state.x[i], state.P[i], j, w, s, F, Q, half, x, P)
            # The error of another load grows with the turn; large steering is likely to change soon.
            turn, steered = min(abs(v * x[YAW]), _HARDEST_MPS2), min(abs(x[R]), _HARDEST_MPS2)
            P[VY, VY] += s.step * ((s.sensed_slip_error if sensed else s.slip_error) * turn) ** 2
            P[AIM, AIM] += s.step * (s.liveliness * steered) ** 2
            sense(x, P, yaw_rate, steer, j, w, v, s, gain, PH)
            if math.isfinite(width):
                shift = int(lane.lane_shift[i])
                x[D] -= shift * width
            if seen:
                # A lane change that the tracker has not reported shows as an offset a lane width away.
                if math.isfinite(width):
                    jump = round((x[D] - z[0]) / width)
                    x[D] -= jump * width
                    shift += jump
                spread = s.one_border_factor if borders == 1 else 1.0
                away = abs(z[0] - x[D]) > s.misfit_m
                pose_spread = spread * s.sensed_look_factor if sensed else spread
                copy_vector(x, x_before)
                copy_matrix(P, P_before)
                off = update(x, P, z, pose_spread, spread, s, gain, PH)
                contradicted = sensed and off > s.doubt_sd
                if off > _GROSS * s.clip_sd and not away:
                    # An abrupt manoeuvre rather than an error of the camera: the variances of what is not
                    # measured are raised. With own sensors that is the lane, not the motion.
                    if sensed:
                        copy_vector(x_before, x)
                        copy_matrix(P_before, P)
                        reopen(P, _REOPENED_SENSED)
                    else:
                        reopen(P, _REOPENED)
                    off = update(x, P, z, pose_spread, spread, s, gain, PH)
                misfits = misfits + 1 if away or off > _GROSS * s.clip_sd else 0
                if contradicted or off > s.doubt_sd:
                    settled = 0.0
                running = misfits <= s.misfit_looks
            elif unseen > s.settle_s - 1e-9:
                settled = 0.0
        if not running:
            begin(z, j, w, v, s, x, P)
            age, misfits, settled = 0.0, 0, 0.0
            if sensed:
                keep(state.running[i], state.x[i], state.P[i], x, P)
                sense(x, P, yaw_rate, steer, j, w, v, s, gain, PH)
                if state.running[i]:
                    age = s.settle_s  # the motion is known
        new.running[i], new.width[i], new.unseen[i] = True, width, unseen
        new.age[i], new.misfits[i], new.settled[i] = age, misfits, settled
        report(i, x, j, w, s, age, width, shift, out)
        out.settled_s[i] = settled


@kernel
def predict(x0, P0, j, w, s, F, Q, half, x, P):  # type: ignore[no-untyped-def]
    """x = Φ x0, P = Φ P0 Φᵀ + Q (eqs. 15, 16) with Φ and Q between the tabled speeds j and j + 1."""
    for r in range(N):
        x[r] = 0.0
        for c in range(N):
            F[r, c] = (1.0 - w) * s.transition[j, r, c] + w * s.transition[j + 1, r, c]
            Q[r, c] = (1.0 - w) * s.noise[j, r, c] + w * s.noise[j + 1, r, c]
            x[r] += F[r, c] * x0[c]
    for r in range(N):
        for c in range(N):
            half[r, c] = 0.0
        for k in range(N):
            f = F[r, k]
            if f != 0.0:
                for c in range(N):
                    half[r, c] += f * P0[k, c]
    for r in range(N):
        for c in range(r + 1):
            total = Q[r, c]
            for k in range(N):
                total += half[r, k] * F[c, k]
            P[r, c] = P[c, r] = total


@kernel
def update(x, P, z, pose_spread, road_spread, s, gain, PH):  # type: ignore[no-untyped-def]
    """Sequential update by the whitened measurements (eqs. 17 to 19).

    Returns the largest innovation in standard deviations. The spreads multiply the standard deviations of
    (d, ψ) and of (mean K, K').
    """
    worst = 0.0
    for m in range(M):
        spread = pose_spread if m < 2 else road_spread
        S, residual = spread * spread, 0.0
        for k in range(M):
            residual += s.whitener[m, k] * z[k]
        for r in range(N):
            residual -= s.whitened[m, r] * x[r]
            PH[r] = 0.0
            for c in range(N):
                PH[r] += P[r, c] * s.whitened[m, c]
        for r in range(N):
            S += s.whitened[m, r] * PH[r]
        limit = s.clip_sd * math.sqrt(S)
        worst = max(worst, abs(residual) / math.sqrt(S))
        if abs(residual) > _GROSS * limit:  # the larger, the less it counts
            residual = _GROSS * limit * limit / residual
        elif abs(residual) > limit:
            residual = math.copysign(limit, residual)
        for r in range(N):
            gain[r] = PH[r] / S
            x[r] += gain[r] * residual
        for r in range(N):
            for c in range(r + 1):
                P[r, c] = P[c, r] = P[r, c] - gain[r] * PH[c]
    return worst


@kernel
def sense(x, P, yaw_rate, steer, j, w, v, s, row, PH):  # type: ignore[no-untyped-def]
    """Update by the gyroscope and by the steering sensor, each where it reads.

    Both are more reliable than the model of the driver. A contradiction means an abrupt manoeuvre, or tyres
    other than modelled: then the variances of what is not measured are raised, so that the offsets do not
    absorb it.
    """
    if math.isfinite(yaw_rate):
        row[:] = 0.0
        row[YAW] = row[GYRO] = 1.0
        _reading(x, P, yaw_rate, s.yaw_rate_noise, s.clip_sd, _REOPENED_BY_YAW_RATE, row, PH)
    if math.isfinite(steer) and v > 0.1:
        row[:] = 0.0
        row[K] = (1.0 - w) * s.steer[j, 0] + w * s.steer[j + 1, 0]
        row[KRATE] = (1.0 - w) * s.steer[j, 1] + w * s.steer[j + 1, 1]
        row[R] = (1.0 - w) * s.steer[j, 2] + w * s.steer[j + 1, 2]
        row[UNREST], row[CALM], row[ALIGNMENT] = s.quick, -s.quick, 1.0
        slowness = max(s.slow_mps / v, 1.0) ** 4
        noise = slowness * (s.steer_noise + (s.steer_scale * steer) ** 2)
        _reading(x, P, steer, noise, s.clip_sd, _REOPENED_BY_STEER, row, PH)


@kernel
def _reading(x, P, z, noise, clip, opened, row, PH):  # type: ignore[no-untyped-def]
    """Update by one reading z = row · x + noise (eqs. 17 to 19).

    `opened`: states whose variance is raised first if the innovation exceeds `clip` standard deviations.
    """
    S, residual = noise, z
    for r in range(N):
        residual -= row[r] * x[r]
        PH[r] = 0.0
        for c in range(N):
            PH[r] += P[r, c] * row[c]
    for r in range(N):
        S += row[r] * PH[r]
    if abs(residual) > clip * math.sqrt(S):
        for k in range(len(opened)):
            a = opened[k]
            P[a, a] += _REOPENED_SD[a] ** 2
            PH[a] += _REOPENED_SD[a] ** 2 * row[a]
            S += _REOPENED_SD[a] ** 2 * row[a] ** 2
    for r in range(N):
        x[r] += PH[r] / S * residual
    for r in range(N):
        for c in range(r + 1):
            P[r, c] = P[c, r] = P[r, c] - PH[r] * PH[c] / S


@kernel
def reopen(P, states):  # type: ignore[no-untyped-def]
    """Raise the variances of these states by _REOPENED_SD²."""
    for k in range(len(states)):
        P[states[k], states[k]] += _REOPENED_SD[states[k]] ** 2


@kernel
def lasts(state, running):  # type: ignore[no-untyped-def]
    """Whether a restart keeps a state: an offset of a sensor, or the motion of a filter that was running."""
    return state >= GYRO or (running and state in (VY, YAW, UNREST, CALM))


@kernel
def keep(running, x0, P0, x, P):  # type: ignore[no-untyped-def]
    """Carry over from (x0, P0) what the vehicle's own sensors measure independently of the lane."""
    for a in range(N):
        if not lasts(a, running) or P0[a, a] <= 0.0:  # or was never known
            continue
        x[a] = x0[a]
        for c in range(N):
            if lasts(c, running) and P0[c, c] > 0.0:
                P[a, c] = P0[a, c]


@kernel
def begin(z, j, w, v, s, x, P):  # type: ignore[no-untyped-def]
    """Start from one look: offset, heading and curvature as seen, in a steady turn along the road."""
    for r in range(N):
        x[r] = 0.0
        for c in range(N):
            P[r, c] = 0.0
        P[r, r] = s.initial[r]
    x[D], x[PSI], x[KRATE] = z[0], z[1], z[3]
    x[K] = z[2] - 0.5 * z[3] * s.preview
    x[VY] = x[K] * ((1.0 - w) * s.steady[j, 0] + w * s.steady[j + 1, 0])
    x[YAW] = x[K] * v


@kernel
def report(i, x, j, w, s, age, width, shift, out):  # type: ignore[no-untyped-def]
    """State x as row i of the MotionEstimate; NaN until the filter has settled."""
    out.lateral_speed_mps[i], out.yaw_rate_rps[i] = x[VY], x[YAW]
    out.lateral_offset_m[i], out.heading_error_rad[i] = x[D], x[PSI]
    out.curvature_1pm[i], out.curvature_rate_1pm2[i] = x[K], x[KRATE]
    here = s.steer[j, 0] * x[K] + s.steer[j, 1] * x[KRATE] + s.steer[j, 2] * x[R]
    next_ = s.steer[j + 1, 0] * x[K] + s.steer[j + 1, 1] * x[KRATE] + s.steer[j + 1, 2] * x[R]
    quick = s.quick * (x[UNREST] - x[CALM])
    out.steer_rad[i] = (1.0 - w) * here + w * next_ + quick
    out.quick_steer_rad[i] = quick
    out.lane_width_m[i], out.lane_shift[i] = width, shift
    if age < s.settle_s - 1e-9:
        unknown(i, out)
        out.lane_shift[i] = shift


@kernel
def forget(i, state, new, out):  # type: ignore[no-untyped-def]
    """Nothing is known of vehicle i: NaN in the estimate, an initial state but for the sensors' offsets."""
    new.running[i], new.age[i], new.misfits[i] = False, 0.0, 0
    new.width[i], new.unseen[i], new.settled[i] = math.nan, 0.0, 0.0
    for r in range(N):
        new.x[i, r] = 0.0
        for c in range(N):
            new.P[i, r, c] = 0.0
    for r in (GYRO, ALIGNMENT):
        new.x[i, r], new.P[i, r, r] = state.x[i, r], state.P[i, r, r]
    unknown(i, out)


@kernel
def unknown(i, out):  # type: ignore[no-untyped-def]
    """NaN in row i of a MotionEstimate."""
    out.lateral_speed_mps[i] = out.yaw_rate_rps[i] = out.steer_rad[i] = math.nan
    out.quick_steer_rad[i], out.settled_s[i] = math.nan, 0.0
    out.lateral_offset_m[i] = out.heading_error_rad[i] = math.nan
    out.curvature_1pm[i] = out.curvature_rate_1pm2[i] = out.lane_width_m[i] = math.nan
    out.lane_shift[i] = 0
