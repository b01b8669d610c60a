"""Kernels of the path prediction over the fleet: the single-track model, and the two baselines.

Each path is integrated both in the present vehicle frame and along the present lane, whose curvature is
K + K' s up to `reach` metres ahead and constant beyond; an implausibly large K' is reduced (`believed`).
"""

import math
from typing import NamedTuple

from sumo_net.compile import kernel
from sumo_net.vehicle import Model

_KINEMATIC_MPS = 0.5  # below, the tyres respond within 5 ms: rolling without slip


class Predictor(NamedTuple):
    """The predictor's parameters as kernels take them."""

    model: Model
    understeer: float
    step_s: float
    steps: int
    follows_road: bool  # False: steer held (paper)
    residual_rate: float  # 1/s, 0 holds the residual
    steer_lag_s: float  # s
    unrest_rad: float  # rad, standard deviation of the fast steering jitter
    unrest_rate: float  # 1/s
    calm_mps2: float  # m/s², residual of a steady driver
    unrest_doubt: float  # how much less of a larger residual is taken for jitter
    preview_s: float  # s
    slow_mps: float  # m/s
    stiffness: float  # 1/s², return to the lane centre
    damping: float  # 1/s
    curvature_reach_m: float  # m
    road_jerk_mps3: float  # m/s³, lateral jerk up to which a change of curvature is believed; inf: always


@kernel
def believed(rate, v, jerk):  # type: ignore[no-untyped-def]
    """The change of curvature that is used: all of it up to |K'| v³ = jerk, none from twice that."""
    return rate * min(max(2.0 - abs(rate) * v * v * v / jerk, 0.0), 1.0)


@kernel
def road(curvature, rate, station, reach):  # type: ignore[no-untyped-def]
    """Curvature of the lane `station` m ahead."""
    return curvature + rate * min(max(station, 0.0), reach)


@kernel
def hold(v, p, step):  # type: ignore[no-untyped-def]
    """Zero-order hold of (v_y, γ) over a step: Φ row by row and G, six numbers; closed form of expm."""
    if v < _KINEMATIC_MPS:
        turn = v / (p.l_f + p.l_r)
        return 0.0, 0.0, 0.0, 0.0, p.l_r * turn, turn
    cross = p.l_r * p.k_r - p.l_f * p.k_f
    a, b = -(p.k_f + p.k_r) / (p.m * v), cross / (p.m * v) - v
    c, d = cross / (p.I * v), -(p.l_f**2 * p.k_f + p.l_r**2 * p.k_r) / (p.I * v)
    mean, half = 0.5 * (a + d), 0.5 * (a - d)
    square = half * half + b * c
    root = math.sqrt(abs(square)) * step
    decay = math.exp(mean * step)
    even, odd = decay, decay * step
    if root > 1e-9:
        if square > 0.0:
            even, odd = decay * math.cosh(root), decay * step * math.sinh(root) / root
        else:
            even, odd = decay * math.cos(root), decay * step * math.sin(root) / root
    e11, e12, e21, e22 = even + half * odd, b * odd, c * odd, even - half * odd
    f, g = p.k_f / p.m, p.l_f * p.k_f / p.I
    h1, h2 = (e11 - 1.0) * f + e12 * g, e21 * f + (e22 - 1.0) * g
    determinant = a * d - b * c
    return e11, e12, e21, e22, (d * h1 - b * h2) / determinant, (a * h2 - c * h1) / determinant


@kernel
def travel(x, y, heading, s, d, psi, v, v_y0, v_y1, yaw0, yaw1, k, rate, reach, h):  # type: ignore[no-untyped-def]
    """One midpoint step of the pose in the vehicle frame (x, y, heading) and on the lane (s, d, psi)."""
    v_y, yaw = 0.5 * (v_y0 + v_y1), 0.5 * (yaw0 + yaw1)
    half = 0.5 * h
    # Over the step the yaw rate is linear, so the mean heading is that of its integral, not the midpoint's.
    mid = heading + h * (yaw0 / 3.0 + yaw1 / 6.0)
    x_new = x + h * (v * math.cos(mid) - v_y * math.sin(mid))
    y_new = y + h * (v * math.sin(mid) + v_y * math.cos(mid))
    k0 = road(k, rate, s, reach)
    along0 = (v * math.cos(psi) - v_y0 * math.sin(psi)) / max(1.0 - d * k0, 0.1)
    psi_mid = psi + half * (0.75 * yaw0 + 0.25 * yaw1 - k0 * along0)
    d_mid = d + half * (v * math.sin(psi) + v_y0 * math.cos(psi))
    k_mid = road(k, rate, s + half * along0, reach)
    along = (v * math.cos(psi_mid) - v_y * math.sin(psi_mid)) / max(1.0 - d_mid * k_mid, 0.1)
    psi_new = psi + h * (yaw - k_mid * along)
    mean = psi_mid + (yaw1 - yaw0) * h / 24.0  # over the step, as above
    d_new = d + h * (v * math.sin(mean) + v_y * math.cos(mean))
    return x_new, y_new, heading + h * yaw, s + h * along, d_new, psi_new


@kernel
def unrest_share(beyond, calm, unrest, doubt):  # type: ignore[no-untyped-def]
    """Expected share of fast jitter in the steer beyond the road's, when that is not estimated.

    For two normal parts with standard deviations `unrest` and `calm`; larger steer is taken as intended.
    """
    return unrest * unrest / (unrest * unrest + calm * calm + doubt * beyond * beyond)


@kernel
def single_track(motion, speed, q, out):  # type: ignore[no-untyped-def]
    """Trajectory by the single-track model from (v, v_y, γ, δ, K) for n vehicles, into `out`."""
    for i in range(speed.size):
        v, v_y, yaw = max(0.0, speed[i]), motion.lateral_speed_mps[i], motion.yaw_rate_rps[i]
        steer, k = motion.steer_rad[i], motion.curvature_1pm[i]
        rate = believed(motion.curvature_rate_1pm2[i], v, q.road_jerk_mps3)
        s, d, psi = 0.0, motion.lateral_offset_m[i], motion.heading_error_rad[i]
        x, y, heading = 0.0, 0.0, 0.0
        e11, e12, e21, e22, g1, g2 = hold(v, q.model, q.step_s)
        per = q.model.l_f + q.model.l_r + q.understeer * v * v
        share = per / max(v, q.slow_mps) ** 2
        ahead = q.preview_s * v
        beyond = steer - per * road(k, rate, ahead, q.curvature_reach_m)
        u, w = motion.quick_steer_rad[i], 0.0
        if math.isnan(u):
            u = beyond * unrest_share(beyond, q.calm_mps2 * share, q.unrest_rad, q.unrest_doubt)
        residual = (beyond - u) / share
        drift = v * math.sin(psi) + v_y * math.cos(psi)
        aim = residual + q.stiffness * d + q.damping * drift  # the driver's intention, without the feedback
        fade = math.exp(-q.residual_rate * q.step_s)
        follow = 1.0 - math.exp(-q.step_s / q.steer_lag_s)
        turns = q.step_s * q.unrest_rate
        keep = math.exp(-turns)
        for j in range(q.steps):
            mean_steer = steer
            if q.follows_road:
                aim *= fade
                before = residual
                residual += follow * (aim - q.stiffness * d - q.damping * drift - residual)
                asked = per * road(k, rate, s + 0.5 * q.step_s * v + ahead, q.curvature_reach_m)
                quick = u - w
                u, w = keep * u, keep * (w + turns * u)
                mean_steer = asked + 0.5 * (share * (before + residual) + quick + u - w)
            v_y1 = e11 * v_y + e12 * yaw + g1 * mean_steer
            yaw1 = e21 * v_y + e22 * yaw + g2 * mean_steer
            x, y, heading, s, d, psi = travel(
                x, y, heading, s, d, psi, v, v_y, v_y1, yaw, yaw1, k, rate, q.curvature_reach_m, q.step_s
            )
            v_y, yaw = v_y1, yaw1
            drift = v * math.sin(psi) + v_y * math.cos(psi)
            out.forward_m[i, j], out.left_m[i, j], out.heading_rad[i, j] = x, y, heading
            out.lane_offset_m[i, j], out.lane_heading_rad[i, j] = d, psi


@kernel
def constant_radius(motion, speed, q, out):  # type: ignore[no-untyped-def]
    """Trajectory with the present yaw rate and slip held, for n vehicles, into `out`."""
    for i in range(speed.size):
        v, v_y, yaw = max(0.0, speed[i]), motion.lateral_speed_mps[i], motion.yaw_rate_rps[i]
        k, rate = motion.curvature_1pm[i], believed(motion.curvature_rate_1pm2[i], v, q.road_jerk_mps3)
        s, d, psi = 0.0, motion.lateral_offset_m[i], motion.heading_error_rad[i]
        x, y, heading = 0.0, 0.0, 0.0
        for j in range(q.steps):
            x, y, heading, s, d, psi = travel(
                x, y, heading, s, d, psi, v, v_y, v_y, yaw, yaw, k, rate, q.curvature_reach_m, q.step_s
            )
            out.forward_m[i, j], out.left_m[i, j], out.heading_rad[i, j] = x, y, heading
            out.lane_offset_m[i, j], out.lane_heading_rad[i, j] = d, psi


@kernel
def constant_velocity(motion, speed, q, out):  # type: ignore[no-untyped-def]
    """Trajectory along the road with the present lateral velocity, d + ḋ t, for n vehicles, into `out`."""
    for i in range(speed.size):
        v, k = max(0.0, speed[i]), motion.curvature_1pm[i]
        rate = believed(motion.curvature_rate_1pm2[i], v, q.road_jerk_mps3)
        d, psi = motion.lateral_offset_m[i], motion.heading_error_rad[i]
        drift = v * math.sin(psi) + motion.lateral_speed_mps[i] * math.cos(psi)
        direction = -psi  # of the lane in the vehicle frame, starting at the foot of the vehicle on the lane
        x, y = d * math.sin(direction), -d * math.cos(direction)
        for j in range(q.steps):
            t, h = (j + 1) * q.step_s, q.step_s
            s = j * h * v
            turn = (
                0.5
                * h
                * v
                * (road(k, rate, s, q.curvature_reach_m) + road(k, rate, s + h * v, q.curvature_reach_m))
            )
            x += h * v * math.cos(direction + 0.5 * turn)
            y += h * v * math.sin(direction + 0.5 * turn)
            direction += turn
            offset = d + drift * t
            out.forward_m[i, j] = x - offset * math.sin(direction)
            out.left_m[i, j] = y + offset * math.cos(direction)
            out.heading_rad[i, j] = direction + psi
            out.lane_offset_m[i, j], out.lane_heading_rad[i, j] = offset, psi
