"""The lateral driver model of an equipped vehicle: traits drawn once per driver, and the present state.

A driver keeps the lane by second-order feedback of lateral offset and heading error, and by a feed-forward
of curvature. The steering is disturbed by Ornstein-Uhlenbeck noise, scaled to the driver's standard deviation
of lateral position (SDLP). Glances away (distraction) and microsleeps freeze the steering. Lane changes that
SUMO makes are followed along a smooth profile. The kernels are in `driver_kernels`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field, model_validator
from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

from sumo_net.arrays import Array
from sumo_net.driver_kernels import TABLE_SPEED_STEP_MPS
from sumo_net.randomness import generator, stream_key
from sumo_net.settings import kernel_view, settings
from sumo_net.step import STEP_S
from sumo_net.vehicle import Vehicle, single_track

# of what a vehicle does, by LANE_KEEPING to UNSIGNALLED_CHANGE of driver_kernels
CAUSES = ("lane_keeping", "distraction", "microsleep", "lane_change_signalled", "lane_change_unsignalled")

_SPEEDS_MPS = [k * TABLE_SPEED_STEP_MPS for k in range(16)]  # up to 60 m/s; the kernel clamps beyond
HEAVY_MPS = 28.0  # 100 km/h, the fastest that coaches may drive in Europe: every vehicle must keep its lane


@settings
class Driver:
    """The population of drivers. The defaults give about 9 departures per 100 km at 110 km/h."""

    sleepy_share: float = Field(0.10, ge=0, le=1, description="share of drivers that are sleepy")
    alert_sd_least_m: float = Field(
        0.18, ge=0, description="standard deviation of the lateral position (SDLP) of alert drivers, lowest"
    )
    alert_sd_most_m: float = Field(0.20, ge=0, description="SDLP of alert drivers, highest")
    sleepy_sd_least_m: float = Field(0.30, ge=0, description="SDLP of sleepy drivers, lowest")
    sleepy_sd_most_m: float = Field(0.45, ge=0, description="SDLP of sleepy drivers, highest")
    offset_sd_m: float = Field(
        0.12, ge=0, description="standard deviation between drivers of the mean lateral position"
    )
    offset_most_m: float = Field(
        0.30, ge=0, description="greatest distance of any driver's mean position from the centre"
    )

    bandwidth_rps: float = Field(0.70, gt=0, le=2, description="natural frequency of lane keeping, rad/s")
    damping: float = Field(0.80, gt=0, le=2, description="damping ratio of lane keeping")
    tight_gain: float = Field(
        2.5,
        ge=0,
        le=4,
        description="in tight turns (R < 25 m) bandwidth and correction are multiplied by 1 + this",
    )
    jitter_sd_rad: float = Field(
        3.3e-4,
        ge=0,
        le=0.01,
        description="fast steering noise at the front wheels around 1 Hz (hands, road); the default makes "
        "0.27 mrad between 1 and 3 Hz, as a recorded freeway drive shows (0.24° at the steering "
        "wheel)",
    )
    jitter_time_s: float = Field(
        0.16,
        gt=0.02,
        description="time constant of the fast steering noise, which peaks at 1 / (2π · this) Hz",
    )
    noise_time_s: float = Field(1.5, gt=0, description="correlation time of the steering disturbance")
    steer_lag_s: float = Field(0.15, gt=0.02, description="time constant of arm and wheel")
    steer_rate_most_rps: float = Field(
        0.50, gt=0, description="highest steering rate of the front wheels, rad/s"
    )
    steer_most_rad: float = Field(0.60, gt=0, le=1, description="largest steering angle of the front wheels")
    correction_most_mps2: float = Field(
        2.5, gt=0, description="most lateral acceleration for corrections, beyond that of the curve"
    )
    friction: float = Field(0.80, gt=0, le=1.5, description="highest total lateral acceleration, over g")
    bend_mps2: float = Field(
        4.0, gt=0, description="slows down for bends that would need more lateral acceleration than this"
    )
    bend_braking_mps2: float = Field(2.0, gt=0, le=9, description="deceleration before such bends")
    slow_mps: float = Field(
        8.0, gt=1, description="below this speed, control and lane changes go by distance instead of time"
    )

    distraction_per_min: float = Field(
        2.5, ge=0, description="glances away per minute, during which the steering is frozen"
    )
    glance_mean_s: float = Field(1.1, gt=0, description="mean duration of a glance (lognormal)")
    glance_log_sd: float = Field(
        0.6, ge=0, description="standard deviation of the logarithm of that duration"
    )
    drift_sd_mps2: float = Field(
        0.10,
        ge=0,
        description="lateral acceleration by the error of the frozen steering angle, standard deviation",
    )
    microsleep_per_min: float = Field(0.10, ge=0, description="microsleeps per minute of sleepy drivers")
    microsleep_least_s: float = Field(3.0, gt=0, description="shortest microsleep")
    microsleep_most_s: float = Field(15.0, gt=0, description="longest microsleep (uniform between)")
    calm_curve_mps2: float = Field(
        1.5,
        ge=0,
        description="glances and microsleeps begin only where the curve needs less lateral acceleration than "
        "this",
    )
    calm_change_mps2: float = Field(
        0.4, ge=0, description="and only where that changes by less than this within the next 3 s"
    )
    wake_beyond_border_m: float = Field(
        0.15,
        ge=0,
        description="a wheel this far beyond the border (rumble strip, traffic) startles the driver",
    )
    startle_s: float = Field(0.4, gt=0, description="time from being startled to steering again")
    reaction_mean_s: float = Field(0.8, gt=0, description="time from a warning to steering again, mean")
    reaction_sd_s: float = Field(0.2, ge=0, description="standard deviation of that between drivers")

    lane_change_least_s: float = Field(4.0, ge=2, description="shortest duration of a lane change")
    lane_change_most_s: float = Field(6.0, ge=2, description="longest duration of a lane change")
    signal_probability: float = Field(
        0.92, ge=0, le=1, description="mean share of lane changes with the turn signal"
    )
    signal_spread: float = Field(
        0.08, ge=0, le=0.5, description="half width of the uniform distribution of that share between drivers"
    )

    @model_validator(mode="after")
    def _ordered(self) -> "Driver":
        for least, most in (
            ("alert_sd_least_m", "alert_sd_most_m"),
            ("sleepy_sd_least_m", "sleepy_sd_most_m"),
            ("microsleep_least_s", "microsleep_most_s"),
            ("lane_change_least_s", "lane_change_most_s"),
        ):
            low, high = getattr(self, least), getattr(self, most)
            if low > high:
                raise ValueError(f"{least} = {low} is above {most} = {high}")
        return self


class Traits(NamedTuple):
    """Constant traits of n drivers."""

    offset_m: Array  # (n,) mean lateral position
    sd_m: Array  # (n,) SDLP
    sleepy: Array  # (n,) bool
    signal_probability: Array  # (n,)
    change_s: Array  # (n,) duration of a lane change
    reaction_s: Array  # (n,)
    half_span_m: Array  # (n,) to the outer edge of a front wheel
    noise_key: Array  # (n,) uint64
    event_key: Array  # (n,) uint64


class Mind(NamedTuple):
    """Present state of n drivers."""

    noise: Array  # (n,) the slow disturbance, standard normal
    unrest: Array  # (n,) noise whose high-pass part is the jitter, standard normal
    calm: Array  # (n,) the low-pass part of `unrest`
    cause: Array  # (n,) int8, LANE_KEEPING ... UNSIGNALLED_CHANGE; held until the driver has recovered
    episode_left_s: Array  # (n,) positive while the steering is frozen
    recovery_left_s: Array  # (n,) positive while a past episode is still the cause of what happens
    held_steer_rad: Array  # (n,) while frozen
    drift_mps2: Array  # (n,) while frozen: error of the held steer, as lateral acceleration
    until_glance_s: Array  # (n,)
    until_microsleep_s: Array  # (n,) infinite for alert drivers
    change_from_m: Array  # (n,) lane-change profile: position,
    change_rate_mps: Array  # (n,)   velocity
    change_rate2_mps2: Array  # (n,) and acceleration at its beginning,
    change_elapsed_s: Array  # (n,) time since,
    change_duration_s: Array  # (n,) and duration
    signal: Array  # (n,) int8 turn signal, +1 left
    veer_from_m: Array  # (n,) a scripted drift: the line it leaves,
    veer_rate_mps: Array  # (n,)   its rate, left positive,
    veer_ramp_s: Array  # (n,)     the time in which the rate is reached,
    veer_elapsed_s: Array  # (n,)  time since its beginning
    veer_left_s: Array  # (n,)     and until its end; 0: no drift
    steps: Array  # (n,) int64 counter of noise draws
    events: Array  # (n,) int64 counter of event draws


class DriverNumbers(NamedTuple):
    """The parameters of a Driver, as kernels take them."""

    bandwidth_rps: float
    damping: float
    tight_gain: float
    noise_time_s: float
    jitter_gain: float  # rad, of unrest minus its slow part
    jitter_keep: float  # decay factor of both per step
    steer_lag_s: float
    steer_rate_most_rps: float
    steer_most_rad: float
    correction_most_mps2: float
    acceleration_most: float
    slow_mps: float
    glance_rate: float
    glance_log_mean: float
    glance_log_sd: float
    drift_sd_mps2: float
    microsleep_rate: float
    microsleep_least_s: float
    microsleep_most_s: float
    calm_curve_mps2: float
    calm_change_mps2: float
    wake_beyond_border_m: float
    startle_s: float
    understeer: float  # K_u / L
    wheelbase: float
    noise_scale: Array  # (16,) disturbance in m/s² per metre of SDLP at 0, 4, … 60 m/s
    jitter_lateral: Array  # (16,) SDLP in m due to the jitter alone
    preview_s: Array  # (16,) at which the driver reads curvature and desired line


def numbers(driver: Driver, vehicle: Vehicle) -> DriverNumbers:
    """Kernel parameters of a population of drivers in a vehicle. Raises ValueError as `stable_to_mps`."""
    keep = math.exp(-STEP_S / driver.jitter_time_s)
    stable_mps = stable_to_mps(driver, vehicle)
    parts = [lateral_sds(driver, vehicle, min(max(v, driver.slow_mps), stable_mps)) for v in _SPEEDS_MPS]
    preview = [max(driver.steer_lag_s + response_delay(vehicle, max(v, 1.0)), 0.0) for v in _SPEEDS_MPS]
    return kernel_view(
        DriverNumbers,
        driver,
        jitter_gain=driver.jitter_sd_rad / quick_sd(keep),
        jitter_keep=keep,
        acceleration_most=driver.friction * 9.81,
        glance_rate=driver.distraction_per_min / 60.0,
        glance_log_mean=math.log(driver.glance_mean_s) - 0.5 * driver.glance_log_sd**2,
        microsleep_rate=driver.microsleep_per_min / 60.0,
        understeer=vehicle.understeer / vehicle.wheelbase_m,
        wheelbase=vehicle.wheelbase_m,
        noise_scale=np.array([1.0 / slow for slow, _ in parts]),
        jitter_lateral=np.array([driver.jitter_sd_rad * quick for _, quick in parts]),
        preview_s=np.array(preview),
    )


def stable_to_mps(driver: Driver, vehicle: Vehicle) -> float:
    """Speed up to which the closed loop of driver and vehicle is stable, of those tabulated; inf: all.

    A heavy vehicle answers the steering so late at speeds it never drives. Raises ValueError for less than
    HEAVY_MPS.
    """
    stable = math.inf
    for v in _SPEEDS_MPS[::-1]:
        speed = max(v, driver.slow_mps)
        if np.linalg.eigvals(_closed_loop(driver, vehicle, speed)[0]).real.max() >= 0.0:
            stable = v - TABLE_SPEED_STEP_MPS
    if stable < HEAVY_MPS:
        raise ValueError(
            f"driver.bandwidth_rps = {driver.bandwidth_rps}, damping = {driver.damping}, steer_lag_s = "
            f"{driver.steer_lag_s}: lane keeping with this `vehicle` is unstable at "
            f"{max(stable + TABLE_SPEED_STEP_MPS, driver.slow_mps):.0f} m/s; a smaller bandwidth_rps or "
            "steer_lag_s is needed"
        )
    return stable


def lateral_sds(driver: Driver, vehicle: Vehicle, speed_mps: float) -> tuple[float, float]:
    """SDLP in m due to a disturbance of 1 m/s², and due to jitter of 1 rad (standard deviations).

    From the Lyapunov equation of the closed loop, which must be stable.
    """
    F, steer = _closed_loop(driver, vehicle, speed_mps)
    _, B = single_track(vehicle, speed_mps)
    slow, quick = F.copy(), F.copy()
    slow[4, 5] = steer
    quick[:2, 5:] = math.sqrt(2.0) * B @ np.array([[1.0, -1.0]])  # the fast part has half of the variance
    quick[5, 5] = quick[6, 6] = -1.0 / driver.jitter_time_s
    quick[6, 5] = 1.0 / driver.jitter_time_s
    Q = np.zeros((7, 7))
    Q[5, 5] = 2.0
    return (
        math.sqrt(solve_continuous_lyapunov(slow, -Q / driver.noise_time_s)[2, 2]),
        math.sqrt(solve_continuous_lyapunov(quick, -Q / driver.jitter_time_s)[2, 2]),
    )


def _closed_loop(driver: Driver, vehicle: Vehicle, speed_mps: float) -> tuple[Array, float]:
    """F (7, 7) of driver and vehicle, and the gain from a disturbance in m/s² to the steering.

    State (v_y, γ, d, e, δ, n, m): the vehicle, its offset and heading error, the steer, a disturbance or
    jitter, and the slow part of the latter.
    """
    v, w, T = speed_mps, driver.bandwidth_rps, driver.steer_lag_s
    F = np.zeros((7, 7))
    A, B = single_track(vehicle, v)
    F[:2, :2], F[:2, 4] = A, B[:, 0]
    F[2, 0], F[2, 3], F[3, 1] = 1.0, v, 1.0
    rate = 2.0 * driver.damping * w
    steer = (vehicle.wheelbase_m + vehicle.understeer * v**2) / v**2 / T
    F[4, :5] = steer * np.array([-rate, 0.0, -(w**2), -rate * v, 0.0])
    F[4, 4] = -1.0 / T
    F[5, 5] = F[6, 6] = -1.0 / driver.noise_time_s
    return F, steer


def quick_sd(keep: float) -> float:
    """Standard deviation of a - b for a⁺ = keep·a + √(1 - keep²)·n and b⁺ = keep·b + (1 - keep)·a."""
    F = np.array([[keep, 0.0], [1.0 - keep, keep]])
    P = solve_discrete_lyapunov(F, np.diag([1.0 - keep**2, 0.0]))
    return math.sqrt(P[0, 0] + P[1, 1] - 2.0 * P[0, 1])


def response_delay(vehicle: Vehicle, speed_mps: float) -> float:
    """Delay in s of lateral acceleration behind a slowly varying steer: −d/ds ln G(s) at s = 0.

    A driver whose preview is this plus the lag of arms and steering neither cuts bends nor runs wide.
    """
    A, B = single_track(vehicle, speed_mps)
    C = A[0] + np.array([0.0, speed_mps])  # a_y = v̇_y + v γ
    once = np.linalg.solve(A, B[:, 0])
    return float(C @ np.linalg.solve(A, once) / (B[0, 0] - C @ once))


def traits(driver: Driver, vehicle: Vehicle, seed: int, vehicle_ids: Sequence[str], width_m: Array) -> Traits:
    """Draw the drivers of n vehicles, each from (seed, vehicle id) alone.

    `width_m` (n,): body widths. The wheels' outer span is in proportion to it.
    """
    rows = [_traits_of(driver, seed, vehicle_id) for vehicle_id in vehicle_ids]
    columns = list(zip(*rows, strict=True)) if rows else [()] * 6
    parts = [np.array(column, dtype=float) for column in columns]
    return Traits(
        offset_m=parts[0],
        sd_m=parts[1],
        sleepy=parts[2].astype(bool),
        signal_probability=parts[3],
        change_s=parts[4],
        reaction_s=parts[5],
        half_span_m=0.5 * vehicle.wheel_span_m / vehicle.width_m * np.asarray(width_m, dtype=float),
        noise_key=np.array([stream_key(seed, name, "lane keeping") for name in vehicle_ids], dtype=np.uint64),
        event_key=np.array([stream_key(seed, name, "driver events") for name in vehicle_ids], np.uint64),
    )


def _traits_of(driver: Driver, seed: int, vehicle_id: str) -> tuple[float, ...]:
    random = generator(seed, vehicle_id, "driver")
    sleepy = random.random() < driver.sleepy_share
    of_sd, of_signal, of_change = random.random(3)
    of_offset, of_reaction = random.standard_normal(2)
    least, most = (
        (driver.sleepy_sd_least_m, driver.sleepy_sd_most_m)
        if sleepy
        else (driver.alert_sd_least_m, driver.alert_sd_most_m)
    )
    signal = driver.signal_probability + driver.signal_spread * (2.0 * of_signal - 1.0)
    change = driver.lane_change_least_s + of_change * (driver.lane_change_most_s - driver.lane_change_least_s)
    return (
        float(np.clip(driver.offset_sd_m * of_offset, -driver.offset_most_m, driver.offset_most_m)),
        least + of_sd * (most - least),
        float(sleepy),
        min(max(signal, 0.0), 1.0),
        change,
        max(driver.reaction_mean_s + driver.reaction_sd_s * of_reaction, 0.3),
    )


def attentive(traits: Traits) -> Mind:
    """Initial state of n drivers: on their line, undisturbed; times of first episodes not drawn (NaN)."""
    n = len(traits.offset_m)

    def zeros() -> Array:
        return np.zeros(n)

    return Mind(
        noise=zeros(),
        unrest=zeros(),
        calm=zeros(),
        cause=np.zeros(n, np.int8),
        episode_left_s=zeros(),
        recovery_left_s=zeros(),
        held_steer_rad=zeros(),
        drift_mps2=zeros(),
        until_glance_s=np.full(n, np.nan),
        until_microsleep_s=np.full(n, np.nan),
        change_from_m=traits.offset_m.copy(),
        change_rate_mps=zeros(),
        change_rate2_mps2=zeros(),
        change_elapsed_s=np.ones(n),
        change_duration_s=np.ones(n),
        signal=np.zeros(n, np.int8),
        veer_from_m=zeros(),
        veer_rate_mps=zeros(),
        veer_ramp_s=np.ones(n),
        veer_elapsed_s=zeros(),
        veer_left_s=zeros(),
        steps=np.zeros(n, np.int64),
        events=np.zeros(n, np.int64),
    )
