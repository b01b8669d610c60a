"""Common interface of the observers: Z11's bank (`paper`, camera only) and the filter (`refined`).

table = schedule(vehicle, camera.preview_m, ObserverSettings())
state = init(n, table)
state, motion = step(state, table, lane, speed_mps, own)
"""

from typing import Literal

import numpy as np
from pydantic import Field

from plugin.lane.estimate import LaneEstimate
from plugin.motion import bank, filter
from plugin.motion.bank import BankSettings
from plugin.motion.bank_kernels import BankSchedule, BankState
from plugin.motion.estimate import MotionEstimate, OwnReadings
from plugin.motion.filter import FilterSettings
from plugin.motion.filter_kernels import GYRO, FilterSchedule, FilterState
from sumo_net.arrays import Array
from sumo_net.settings import settings
from sumo_net.vehicle import Vehicle

Schedule = BankSchedule | FilterSchedule
State = BankState | FilterState


@settings
class ObserverSettings:
    """Estimation of the vehicle's motion."""

    mode: Literal["paper", "refined"] = Field(
        "refined", description="paper: the observer bank of Zhang et al.; refined: the default filter"
    )
    coast_s: float = Field(
        1.0,
        ge=0,
        le=5,
        description="time for which the estimate is continued without a lane; then it is unknown",
    )
    bank: BankSettings = Field(BankSettings(), description="of mode paper")
    filter: FilterSettings = Field(FilterSettings(), description="of mode refined")


def schedule(vehicle: Vehicle, preview_m: float, settings: ObserverSettings, step_s: float = 0.1) -> Schedule:
    """All that is computed at set-up; preview_m is the camera's D_L."""
    if settings.mode == "paper":
        return bank.schedule(vehicle, preview_m, settings.bank, settings.coast_s, step_s)
    return filter.schedule(vehicle, preview_m, settings.filter, settings.coast_s, step_s)


def init(n: int, schedule: Schedule) -> State:
    """State of n vehicles that have not seen a lane yet."""
    return bank.init(n) if isinstance(schedule, BankSchedule) else filter.init(n)


def step(
    state: State,
    schedule: Schedule,
    lane: LaneEstimate,
    speed_mps: Array,
    own: OwnReadings | None = None,
) -> tuple[State, MotionEstimate]:
    """One step of 0.1 s for n vehicles; speed_mps (n,) from the vehicle's own speedometer.

    `own`: yaw rate and steer, None for a camera alone; Z11's bank does not use them. Without a lane it coasts
    for `coast_s`; after that all is NaN. Raises TypeError for a state of the other mode.
    """
    if isinstance(schedule, BankSchedule) and isinstance(state, BankState):
        return bank.step(state, schedule, lane, speed_mps)
    if isinstance(schedule, FilterSchedule) and isinstance(state, FilterState):
        return filter.step(state, schedule, lane, speed_mps, own)
    raise TypeError(f"{type(state).__name__} is not the state of a {type(schedule).__name__}")


def yaw_rate(state: State, motion: MotionEstimate, measured_rps: Array) -> Array:
    """The best yaw rate (n,) for the radar: as observed, else the gyroscope's minus its estimated offset."""
    known = measured_rps - gyroscope_offset(state)
    return np.where(np.isfinite(motion.yaw_rate_rps), motion.yaw_rate_rps, known)


def gyroscope_offset(state: State) -> Array:
    """Estimated offset (n,) of the gyroscope in rad/s; 0 in mode paper."""
    return state.x[:, GYRO] if isinstance(state, FilterState) else np.zeros(len(state.running))
