"""The default observer: yaw rate and lateral speed from camera and own sensors, at any speed.

Zhang et al. 2011 treat the steer as a known input, differentiated from the image. In this filter it is part
of the state: what the road's curvature (a little ahead of the vehicle) needs, plus a residual of the driver,
a lateral acceleration modelled as an Ornstein-Uhlenbeck process behind the lag of arms and steering, plus
fast jitter around 1 Hz. Offset and heading make the steer observable, and the single-track model gives yaw
rate and lateral speed. What the model neglects (load, wind) is process noise of both; that of the lateral
speed grows with the turn.

The camera's errors are mostly not independent from look to look. A narrow camera sees the road from about
`pivot_m` ahead on; the lane under the wheels is remembered by the tracker. So heading and offset err
together, as if the lane were bent about that point, and so does the mean curvature, since the direction at
the preview point is seen. Such errors last for seconds (a state), or are in proportion to v_y if the tracker
assumes rolling without slip.

A gyroscope and a steering sensor, where the vehicle has them, are two more measurements: of γ and of the
steer, each with a slowly drifting offset as a state. Without them the camera is the only source.

The model is linear for a given speed: Φ and Q are computed for a table of speeds at set-up and interpolated.
The exact discretisation of the single-track model tends to rolling without slip by itself as v → 0.
"""

import math

import numpy as np
from filterpy.common import van_loan_discretization
from pydantic import Field

from plugin.lane.estimate import LaneEstimate
from plugin.motion import filter_kernels
from plugin.motion.estimate import MotionEstimate, OwnReadings, blank, no_readings
from plugin.motion.filter_kernels import (
    AIM,
    ALIGNMENT,
    BIAS,
    CALM,
    GYRO,
    KRATE,
    PSI,
    UNREST,
    VY,
    YAW,
    D,
    FilterSchedule,
    FilterState,
    K,
    M,
    N,
    R,
)
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings
from sumo_net.vehicle import STANDSTILL_MPS, Vehicle, single_track, steady_state

_TABLE_STEP_MPS = 1.0
_FASTEST_MPS = 80.0
_DOUBLINGS = 6
_UNKNOWN_V_Y, _UNKNOWN_YAW = 0.2, 0.05  # standard deviations at first sight, m/s and rad/s


@settings
class FilterSettings:
    """Assumptions of the filter on camera, road and driver, as standard deviations."""

    offset_m: float = Field(
        0.002,
        gt=0,
        description="camera: noise of the offset at pivot_m that is independent from frame to frame",
    )
    heading_rad: float = Field(
        1e-4, gt=0, description="camera: noise of the heading that is independent from frame to frame"
    )
    curvature_1pm: float = Field(
        3e-5, gt=0, description="camera: noise of the mean curvature up to the preview point"
    )
    curvature_rate_1pm2: float = Field(3e-6, gt=0, description="camera: noise of the change of curvature")
    one_border_factor: float = Field(
        1.5, ge=1, description="camera: factor on these four while only one border is seen"
    )
    heading_bias_rad: float = Field(4e-4, gt=0, description="camera: correlated error of the heading")
    heading_bias_time_s: float = Field(2.0, gt=0, description="camera: correlation time of that error")
    pivot_m: float = Field(
        11.5,
        ge=0,
        description="camera: distance ahead at which an error of the heading does not move the lane",
    )
    heading_per_slip: float = Field(
        0.0,
        ge=0,
        description="camera: error of the heading in rad per m/s of v_y, for a tracker that ignores slip",
    )

    road_curvature_rate_1pm2: float = Field(
        3e-5, gt=0, description="road: standard deviation of the change of curvature"
    )
    road_length_m: float = Field(30.0, gt=0, description="road: correlation length of that change")

    residual_mps2: float = Field(
        0.3, gt=0, description="driver: lateral acceleration beyond what the road needs"
    )
    residual_time_s: float = Field(1.5, gt=0, description="driver: correlation time of that residual")
    liveliness: float = Field(
        1.0,
        ge=0,
        description="driver: the residual grows by this share of the lateral acceleration that is steered "
        "for, 1/√s",
    )
    steer_lag_s: float = Field(
        0.15, gt=0, description="driver: time constant with which the steering follows"
    )
    unrest_rad: float = Field(3.3e-4, gt=0, description="driver: fast steering noise")
    unrest_time_s: float = Field(
        0.16, gt=0, description="driver: time constant of that noise, which peaks at 1 / (2π · this) Hz"
    )
    preview_s: float = Field(
        0.4, ge=0, le=3, description="driver: time ahead from which curvature is steered for"
    )
    slow_mps: float = Field(8.0, gt=0, description="driver: below this speed, the residual goes by distance")

    lateral_speed_noise: float = Field(0.003, ge=0, description="model: v_y, m/s per √s")
    slip_error: float = Field(0.03, ge=0, description="model: error of v̇_y as a share of v γ (load), √s")
    yaw_rate_noise: float = Field(5e-4, ge=0, description="model: γ, rad/s per √s")
    heading_noise: float = Field(1e-5, ge=0, description="model: ψ, rad per √s")

    yaw_rate_reading_rps: float = Field(1.1e-3, gt=0, description="gyroscope: noise of a reading")
    yaw_rate_offset_rps: float = Field(
        2e-3, gt=0, description="gyroscope: standard deviation of the offset at the start"
    )
    yaw_rate_walk: float = Field(2e-5, ge=0, description="gyroscope: random walk of the offset, rad/s per √s")
    steer_reading_rad: float = Field(
        5e-5, gt=0, description="steering: noise of a reading, at the front wheels"
    )
    steer_scale: float = Field(0.01, ge=0, description="steering: further noise, as a share of the angle")
    steer_offset_rad: float = Field(
        1.1e-3, gt=0, description="steering: standard deviation of the offset at the start"
    )
    steer_walk: float = Field(1.1e-5, ge=0, description="steering: random walk of the offset, rad per √s")
    sensed_look_factor: float = Field(
        2.0,
        gt=0,
        description="factor on offset_m and heading_rad while gyroscope and steering sensor read: the "
        "camera's errors are correlated in time, which matters once the motion is known without "
        "the camera",
    )
    sensed_slip_error: float = Field(
        0.02, ge=0, description="slip_error while gyroscope and steering sensor read"
    )

    clip_sd: float = Field(
        6.0,
        gt=1,
        description="an innovation of more sd than this counts less; of more than twice as many, it is gross",
    )
    doubt_sd: float = Field(
        16.0,
        gt=1,
        description="a camera measurement this many standard deviations off contradicts the estimate, and no "
        "warning begins",
    )
    misfit_m: float = Field(
        0.3, gt=0, description="a camera measurement whose offset is this far off is a misfit, too"
    )
    misfit_looks: int = Field(3, ge=1, description="misfits in a row that restart the filter")
    settle_s: float = Field(0.3, ge=0, description="no warning begins for this time after a start")
    width_share: float = Field(0.05, gt=0, le=1, description="weight of a new lane width in the filtered one")


def continuous_model(vehicle: Vehicle, settings: FilterSettings, speed_mps: float) -> tuple[Array, Array]:
    """F (11, 11) and the noise input G (11, 11), for unit white noises w, of dx/dt = F x + G w.

    Of all states but the sensors' offsets, on which none of the others depends.
    """
    c, v = settings, speed_mps
    F, G = np.zeros((GYRO, GYRO)), np.zeros((GYRO, GYRO))
    A, B = single_track(vehicle, max(v, STANDSTILL_MPS))
    F[:2, :2] = A
    for state, share in zip((K, KRATE, R), steer_shares(vehicle, c, v), strict=True):
        F[:2, state] = B[:, 0] * share
    F[D, VY], F[D, PSI] = 1.0, v
    F[PSI, YAW], F[PSI, K] = 1.0, -v
    F[K, KRATE] = v
    F[KRATE, KRATE] = -v / c.road_length_m
    F[R, R], F[R, AIM] = -1.0 / c.steer_lag_s, 1.0 / c.steer_lag_s
    F[AIM, AIM] = -1.0 / c.residual_time_s
    # The driver's fast jitter: a noise u minus its low-pass part w; each of the two has half of the variance.
    F[:2, UNREST], F[:2, CALM] = B[:, 0] * _per_unrest(c), -B[:, 0] * _per_unrest(c)
    F[UNREST, UNREST] = F[CALM, CALM] = -1.0 / c.unrest_time_s
    F[CALM, UNREST] = 1.0 / c.unrest_time_s
    F[BIAS, BIAS] = -1.0 / c.heading_bias_time_s
    G[VY, VY], G[YAW, YAW], G[PSI, PSI] = c.lateral_speed_noise, c.yaw_rate_noise, c.heading_noise
    G[KRATE, KRATE] = c.road_curvature_rate_1pm2 * math.sqrt(2.0 * v / c.road_length_m)
    G[AIM, AIM] = c.residual_mps2 * math.sqrt(2.0 / c.residual_time_s)
    G[UNREST, UNREST] = math.sqrt(2.0 / c.unrest_time_s)
    G[BIAS, BIAS] = c.heading_bias_rad * math.sqrt(2.0 / c.heading_bias_time_s)
    return F, G


def _per_unrest(settings: FilterSettings) -> float:
    """Steer in rad per unit of u − w, whose variance is half of u's unit variance."""
    return settings.unrest_rad * math.sqrt(2.0)


def discretise(F: Array, G: Array, step_s: float) -> tuple[Array, Array]:
    """Φ and Q of a step. Van Loan's method contains e^(−F t), which overflows for the stiff tyres of a slow
    car: it is applied to a 64th of the step, which is then doubled six times.
    """
    transition, noise = van_loan_discretization(F, G, dt=step_s / 2**_DOUBLINGS)
    for _ in range(_DOUBLINGS):
        noise = transition @ noise @ transition.T + noise
        transition = transition @ transition
    return transition, noise


def with_offsets(
    transition: Array, noise: Array, settings: FilterSettings, step_s: float
) -> tuple[Array, Array]:
    """Φ (13, 13) and Q (13, 13) with the sensors' offsets added, each a random walk."""
    full, walk = np.eye(N), np.zeros((N, N))
    full[:GYRO, :GYRO], walk[:GYRO, :GYRO] = transition, noise
    walk[GYRO, GYRO] = settings.yaw_rate_walk**2 * step_s
    walk[ALIGNMENT, ALIGNMENT] = settings.steer_walk**2 * step_s
    return full, walk


def steer_shares(vehicle: Vehicle, settings: FilterSettings, speed_mps: float) -> tuple[float, float, float]:
    """Coefficients of (K, K', residual acceleration) in δ_D: curvature ahead, and the driver's residual."""
    per_curvature = vehicle.wheelbase_m + vehicle.understeer * speed_mps**2
    scale = max(speed_mps, settings.slow_mps)
    return per_curvature, per_curvature * settings.preview_s * speed_mps, per_curvature / scale**2


def schedule(
    vehicle: Vehicle, preview_m: float, settings: FilterSettings, coast_s: float = 1.0, step_s: float = 0.1
) -> FilterSchedule:
    """Discretise on the table of speeds; preview_m is D_L, where the camera reports the curvature."""
    c = settings
    speeds = np.arange(0.0, _FASTEST_MPS + 1e-9, _TABLE_STEP_MPS)
    held = [
        with_offsets(*discretise(*continuous_model(vehicle, c, float(v)), step_s), c, step_s) for v in speeds
    ]
    H, R = measurement(c, preview_m)
    W = np.linalg.inv(np.linalg.cholesky(R))
    near = c.curvature_1pm + 0.5 * preview_m * c.curvature_rate_1pm2
    heading = math.hypot(c.heading_rad, c.heading_bias_rad)
    seen = [math.hypot(c.offset_m, c.pivot_m * heading), heading, near, c.curvature_rate_1pm2]
    own = [c.residual_mps2, c.residual_mps2, 1.0, math.sqrt(0.5), c.heading_bias_rad]
    offsets = [c.yaw_rate_offset_rps, c.steer_offset_rad]
    first = np.array([_UNKNOWN_V_Y, _UNKNOWN_YAW, *seen, *own, *offsets])
    turns = [_turn(vehicle, max(float(v), STANDSTILL_MPS)) for v in speeds]
    return kernel_view(
        FilterSchedule,
        c,
        transition=np.array([transition for transition, _ in held]),
        noise=np.array([noise for _, noise in held]),
        steer=np.array([steer_shares(vehicle, c, float(v)) for v in speeds]),
        steady=np.array(turns),
        initial=first**2,
        whitened=W @ H,
        whitener=W,
        quick=_per_unrest(c),
        spacing=_TABLE_STEP_MPS,
        preview=preview_m,
        step=step_s,
        coast_s=coast_s,
        yaw_rate_noise=c.yaw_rate_reading_rps**2,
        steer_noise=c.steer_reading_rad**2,
    )


def measurement(settings: FilterSettings, preview_m: float) -> tuple[Array, Array]:
    """H (4, 13) and R (4, 4) of a look (d, ψ, mean K up to the preview point, K')."""
    c = settings
    H = np.zeros((M, N))
    H[0, D] = H[1, PSI] = H[2, K] = H[3, KRATE] = 1.0
    H[2, KRATE] = 0.5 * preview_m
    # An error bends the lane about the pivot; direction and curvature at the preview point are seen.
    bent = np.array([-c.pivot_m, 1.0, 1.0 / preview_m, -2.0 / preview_m**2])
    H[:, BIAS], H[:, VY] = bent, c.heading_per_slip * bent
    R = np.diag([c.offset_m, 0.0, c.curvature_1pm, c.curvature_rate_1pm2]) ** 2
    return H, R + c.heading_rad**2 * np.outer(bent, bent)


def _turn(vehicle: Vehicle, speed_mps: float) -> Array:
    """(v_y, γ) of a steady turn of curvature 1."""
    steer = vehicle.wheelbase_m + vehicle.understeer * speed_mps**2
    return steady_state(vehicle, speed_mps, steer)


def init(n: int) -> FilterState:
    """State of n vehicles that have not seen a lane yet."""
    return FilterState(
        np.zeros(n, bool),
        np.zeros((n, N)),
        np.zeros((n, N, N)),
        np.full(n, np.nan),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n, np.int32),
        np.zeros(n),
    )


def step(
    state: FilterState,
    schedule: FilterSchedule,
    lane: LaneEstimate,
    speed_mps: Array,
    own: OwnReadings | None = None,
) -> tuple[FilterState, MotionEstimate]:
    """One step of the filter for n vehicles; speed_mps (n,). Coasts where the lane is not seen."""
    n = len(speed_mps)
    new, out = init(n), blank(n)
    filter_kernels.step(state, schedule, lane, own or no_readings(n), speed_mps, new, out)
    return new, out
