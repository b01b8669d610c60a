"""The observer bank of Zhang et al. 2011, section 3: one steady-state Kalman observer every 10 km/h.

State (v_y, γ, y_L, e_L), input (δ_D, K_L), measurement (y_L, e_L). The gains are computed once from the
discrete Riccati equation. While driving, only the two observers around the present speed run, and their
states are blended. When the speed passes a multiple of 10 km/h, the observer that is added starts from the
state of the one that remains.
"""

import numpy as np
from pydantic import Field
from scipy.linalg import solve_discrete_are

from plugin.lane.estimate import LaneEstimate
from plugin.motion import bank_kernels
from plugin.motion.bank_kernels import BankSchedule, BankState
from plugin.motion.estimate import MotionEstimate, blank
from sumo_net.arrays import Array
from sumo_net.settings import settings
from sumo_net.vehicle import STANDSTILL_MPS, Vehicle, preview_model, zero_order_hold


@settings
class BankSettings:
    """The observers of Zhang et al. 2011 (Z11). The noises are R_1 and R_2 of section 3.2, variances per step
    of 0.1 s.
    """

    spacing_kmh: float = Field(10.0, gt=0, le=50, description="difference of speed between two observers")
    highest_kmh: float = Field(250.0, ge=60, le=400, description="speed of the last observer")
    lateral_speed_noise: float = Field(0.0, ge=0, description="R_1 of v_y, m²/s²; Z11: 0")
    yaw_rate_noise: float = Field(0.0, ge=0, description="R_1 of γ, rad²/s²; Z11: 0")
    preview_offset_noise: float = Field(0.01, gt=0, description="R_1 of y_L, m²")
    preview_heading_noise: float = Field(0.01, gt=0, description="R_1 of e_L, rad²")
    measured_offset_noise: float = Field(0.01, gt=0, description="R_2 of y_L, m²")
    measured_heading_noise: float = Field(0.01, gt=0, description="R_2 of e_L, rad²")
    kinematic_below_mps: float = Field(
        2.0, ge=0, description="below this speed the steering angle is taken from the road's curvature alone"
    )
    dynamic_above_mps: float = Field(5.0, gt=0, description="above this speed it is that of eqs. 10 and 13")


def steady_gain(transition: Array, drive: Array, measured: Array) -> Array:
    """K (4, 2) of eq. 18 in the steady state: the discrete Riccati equation for (y_L, e_L) measured.

    transition is Φ (4, 4), drive R_1 (4, 4), measured R_2 (2, 2).
    """
    H = np.eye(4)[2:]
    P = solve_discrete_are(transition.T, H.T, drive, measured, balanced=False)
    return np.asarray(np.linalg.solve(H @ P @ H.T + measured, H @ P).T)


def schedule(
    vehicle: Vehicle, preview_m: float, settings: BankSettings, coast_s: float = 1.0, step_s: float = 0.1
) -> BankSchedule:
    """Discretise and solve for every multiple of `spacing_kmh`; preview_m is D_L."""
    c = settings
    speeds = np.arange(0.0, c.highest_kmh + 1e-9, c.spacing_kmh) / 3.6
    drive = np.diag(
        [c.lateral_speed_noise, c.yaw_rate_noise, c.preview_offset_noise, c.preview_heading_noise]
    )
    measured = np.diag([c.measured_offset_noise, c.measured_heading_noise])
    held = []
    for v in speeds:
        A, B = preview_model(vehicle, max(v, STANDSTILL_MPS), preview_m)
        held.append(zero_order_hold(A, B, step_s))
    return BankSchedule(
        transition=np.array([transition for transition, _ in held]),
        input=np.array([entry for _, entry in held]),
        gain=np.array([steady_gain(transition, drive, measured) for transition, _ in held]),
        spacing_mps=c.spacing_kmh / 3.6,
        understeer_s2pm=vehicle.understeer,
        wheelbase_m=vehicle.wheelbase_m,
        preview_m=preview_m,
        step_s=step_s,
        coast_s=coast_s,
        low_mps=c.kinematic_below_mps,
        high_mps=max(c.dynamic_above_mps, c.kinematic_below_mps + 0.1),
    )


def init(n: int) -> BankState:
    """State of n vehicles that have not seen a lane yet."""
    return BankState(
        np.zeros(n, bool),
        np.zeros(n, np.int32),
        np.zeros((n, 4)),
        np.zeros((n, 4)),
        np.zeros(n),
        np.zeros(n),
        np.full(n, np.nan),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
    )


def step(
    state: BankState, schedule: BankSchedule, lane: LaneEstimate, speed_mps: Array
) -> tuple[BankState, MotionEstimate]:
    """One step of the bank for n vehicles; speed_mps (n,). Coasts where the lane is not seen."""
    n = len(speed_mps)
    new, out = init(n), blank(n)
    bank_kernels.step(state, schedule, lane, speed_mps, new, out)
    return new, out
