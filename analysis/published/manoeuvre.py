"""True drives of the single-track model on a road of given curvature, and a camera's estimates of them.

Integrated by classical Runge-Kutta in the road's coordinates, from the forces at the axles, without the
matrices and kernels of `sumo_net.vehicle`, so that it is an independent truth for the estimators.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from plugin.lane.estimate import LaneEstimate
from sumo_net.arrays import Array
from sumo_net.vehicle import Vehicle

Steer = Callable[[float, Array, float], float]  # (t, state (v_y, γ, s, d, ψ), v) -> front steer in rad

PREVIEW_M = 33.5


class Drive(NamedTuple):
    """One true drive, k rows in time, (k,) each."""

    time_s: Array
    speed_mps: Array
    lateral_speed_mps: Array
    yaw_rate_rps: Array
    steer_rad: Array
    station_m: Array
    offset_m: Array
    heading_rad: Array
    curvature_1pm: Array
    preview_curvature_1pm: Array
    curvature_rate_1pm2: Array


def drive(
    vehicle: Vehicle,
    steer: Steer,
    speed: Callable[[float], float],
    curvature: Callable[[float], float] = lambda s: 0.0,
    duration_s: float = 10.0,
    start: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0),
    fine_s: float = 0.01,
    each: int = 10,
) -> Drive:
    """Integrate (v_y, γ, s, d, ψ) under steer(t, state, v); one row every `each` fine steps."""
    m, inertia = vehicle.mass_kg, vehicle.yaw_inertia_kgm2
    lf, lr = vehicle.front_axle_m, vehicle.rear_axle_m
    kf, kr = vehicle.front_stiffness_npr, vehicle.rear_stiffness_npr

    def rates(t: float, x: Array, delta: float) -> Array:
        v = speed(t)
        vy, yaw, s, d, psi = x
        force_front = kf * (delta - (vy + lf * yaw) / v)
        force_rear = kr * (lr * yaw - vy) / v
        along = (v * np.cos(psi) - vy * np.sin(psi)) / (1.0 - d * curvature(s))
        return np.array(
            [
                (force_front + force_rear) / m - v * yaw,
                (lf * force_front - lr * force_rear) / inertia,
                along,
                v * np.sin(psi) + vy * np.cos(psi),
                yaw - curvature(s) * along,
            ]
        )

    x, rows = np.array(start), []
    for k in range(round(duration_s / fine_s) + 1):
        t = k * fine_s
        delta = steer(t, x, speed(t))
        if k % each == 0:
            rows.append([t, speed(t), x[0], x[1], delta, x[2], x[3], x[4]])
        k1 = rates(t, x, delta)
        k2 = rates(t + fine_s / 2, x + fine_s / 2 * k1, delta)
        k3 = rates(t + fine_s / 2, x + fine_s / 2 * k2, delta)
        k4 = rates(t + fine_s, x + fine_s * k3, delta)
        x = x + fine_s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    table = np.array(rows).T
    here = np.array([curvature(s) for s in table[5]])
    ahead = np.array([curvature(s + PREVIEW_M) for s in table[5]])
    rate = np.array([(curvature(s + PREVIEW_M) - curvature(s)) / PREVIEW_M for s in table[5]])
    return Drive._make([*table, here, ahead, rate])


def looks(
    truth: Drive,
    rng: np.random.Generator | None = None,
    copies: int = 1,
    offset_m: float = 0.0,
    heading_rad: float = 0.0,
    curvature_1pm: float = 0.0,
    curvature_rate_1pm2: float = 0.0,
    width_m: float = 3.75,
) -> list[LaneEstimate]:
    """Lane estimates, step by step, of a camera with white noise of these standard deviations, for `copies`
    vehicles on the same drive. The preview point is the true one (to second order).
    """
    rng = rng or np.random.default_rng(0)
    out = []
    for k in range(len(truth.time_s)):

        def noisy(value: float, deviation: float) -> Array:
            return value + deviation * rng.standard_normal(copies)

        d = noisy(truth.offset_m[k], offset_m)
        psi = noisy(truth.heading_rad[k], heading_rad)
        rate = noisy(truth.curvature_rate_1pm2[k], curvature_rate_1pm2)
        ahead = noisy(truth.preview_curvature_1pm[k], curvature_1pm)
        near = ahead - rate * PREVIEW_M
        out.append(
            LaneEstimate(
                locked=np.ones(copies, bool),
                score=np.ones(copies),
                lateral_offset_m=d,
                heading_error_rad=psi,
                curvature_1pm=ahead,
                curvature_rate_1pm2=rate,
                lane_width_m=np.full(copies, width_m),
                preview_offset_m=-d - psi * PREVIEW_M + near * PREVIEW_M**2 / 2 + rate * PREVIEW_M**3 / 6,
                preview_heading_rad=-psi + near * PREVIEW_M + rate * PREVIEW_M**2 / 2,
                left_border_seen=np.ones(copies, bool),
                right_border_seen=np.ones(copies, bool),
                left_unseen_m=np.zeros(copies),
                right_unseen_m=np.zeros(copies),
                lane_shift=np.zeros(copies, np.int8),
            )
        )
    return out


def world_path(fine: Drive) -> tuple[Array, Array, Array]:
    """(x, y, heading) of the centre of gravity in the world, starting at the origin along x, for each row.

    Integrated by the trapezoidal rule over the rows: use a Drive with a row every 0.01 s. The initial heading
    is that relative to the road.
    """
    heading = fine.heading_rad[0] + cumulative_trapezoid(fine.yaw_rate_rps, fine.time_s, initial=0)
    cos, sin = np.cos(heading), np.sin(heading)
    v, v_y = fine.speed_mps, fine.lateral_speed_mps
    x = cumulative_trapezoid(v * cos - v_y * sin, fine.time_s, initial=0)
    y = fine.offset_m[0] + cumulative_trapezoid(v * sin + v_y * cos, fine.time_s, initial=0)
    return x, y, heading
