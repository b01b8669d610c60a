"""The filters on (r, ṙ, r̈, β, β̇, β̈): `imm`, and `cv` and `ca` as IMMs of one model.

β̇ and β̈ are over ground: the ego's yaw and the sensor's acceleration are compensated as known inputs, so
that an object does not seem to manoeuvre when the own vehicle turns or brakes.
"""

import functools

import numpy as np
from pydantic import Field

from plugin.tracking import imm, imm_kernels, polar_kernels
from plugin.tracking.detections import Detections, SensorMotion
from plugin.tracking.imm import ImmState
from plugin.tracking.kalman_kernels import MEASURES, STATES
from plugin.tracking.models import (
    POLAR_ANGLE,
    PolarMotion,
    RadarNoise,
    markov_powers,
    polar_models,
)
from sumo_net.arrays import Array
from sumo_net.settings import settings

_MEASURED = np.array(MEASURES)


@settings
class StartSpread:
    """Initial uncertainty of a new object beyond its first detection."""

    lateral_speed_mps: float = Field(2.0, gt=0, description="σ of the speed across the vehicle's axis")
    acceleration_mps2: float = Field(2.0, gt=0, description="σ of the acceleration along each axis")


def first_velocity(
    detections: Detections, c: Array, s: Array, sensor: SensorMotion, options: StartSpread
) -> Array:
    """(3, B) of new objects: v_x, v_y over ground and σ of the unknown part; c, s (B,) : cos β, sin β."""
    out: Array = polar_kernels.first_velocity(
        detections.owner, detections.range_rate_mps, c, s, sensor, options.lateral_speed_mps
    )
    return out


class PolarFilter:
    """The IMM of the models `kinds`; its state is an `ImmState`, z = (r, ṙ, β)."""

    angle = POLAR_ANGLE

    def __init__(
        self,
        kinds: tuple[str, ...],
        markov: Array,
        motion: PolarMotion,
        noise: RadarNoise,
        spread: StartSpread,
        mount_forward_m: float,
    ) -> None:
        self.models = polar_models(kinds, motion)
        self.markov = imm.check_markov(markov, len(kinds))
        self._step_s, self._R = motion.step_s, noise.covariance
        self._spread, self._mount = spread, mount_forward_m

    def start(self, detections: Detections, sensor: SensorMotion) -> ImmState:
        c, s = np.cos(detections.azimuth_rad), np.sin(detections.azimuth_rad)
        velocity = first_velocity(detections, c, s, sensor, self._spread)
        count, r = len(c), len(self.models.names)
        new = ImmState(
            np.empty((count, r, STATES)), np.empty((count, r, STATES, STATES)), np.empty((count, r))
        )
        z, owner, acceleration = self.measure(detections), detections.owner, self._spread.acceleration_mps2
        polar_kernels.start(*new, z, c, s, velocity, owner, sensor, self._R, acceleration)
        return new

    def join(self, state: ImmState, tracks: int, new: ImmState) -> ImmState:
        for part, begun in zip(state, new, strict=True):
            part[tracks : tracks + len(begun)] = begun  # room reserved by the prediction
        return state

    def predict(
        self, state: ImmState, rows: Array, owner: Array, dt: Array, sensor: SensorMotion, room: int
    ) -> tuple[ImmState, Array]:
        if len(dt) and dt[0] == dt.min() == dt.max():
            (F, Q, markov), which = self._transition(float(dt[0])), np.zeros(len(dt), np.int64)
        else:
            steps, which = np.unique(dt, return_inverse=True)
            F, Q = self.models.transition(steps)
            markov = markov_powers(self.markov, steps, self._step_s)
        *parts, lost = polar_kernels.predict(*state, rows, F, Q, markov, which, owner, dt, sensor, room)
        return ImmState(*parts), lost

    def expect(self, state: ImmState, owner: Array, sensor: SensorMotion) -> tuple[Array, Array]:
        expected, S = imm_kernels.expect(len(owner), *state, self._R)
        return expected, S

    def measure(self, detections: Detections) -> Array:
        z = np.empty((len(detections.owner), 3))
        z[:, 0], z[:, 1], z[:, 2] = detections[1:4]  # range, range rate, azimuth
        return z

    def update(
        self, state: ImmState, z: Array, chosen: Array, owner: Array, sensor: SensorMotion
    ) -> ImmState:
        imm_kernels.update(*state, z, chosen, self._R, POLAR_ANGLE)
        return state

    def restart(self, state: ImmState, lost: Array) -> ImmState:
        """Covariances as for new tracks and equal mode probabilities where `lost` (T,)."""
        rows = np.flatnonzero(lost)
        P, mu = state.P.copy(), state.mu.copy()
        r = np.maximum(state.x[rows, :, 0], 1.0)
        fresh = np.zeros((*r.shape, STATES, STATES))
        fresh[..., _MEASURED[:, None], _MEASURED] = self._R
        fresh[..., 2, 2] = self._spread.acceleration_mps2**2
        fresh[..., 4, 4] = (self._spread.lateral_speed_mps / r) ** 2
        fresh[..., 5, 5] = (self._spread.acceleration_mps2 / r) ** 2
        P[rows], mu[rows] = fresh, 1.0 / mu.shape[1]
        return ImmState(state.x, P, mu)

    def estimate(self, state: ImmState, owner: Array, sensor: SensorMotion) -> Array:
        cv = self.models.names.index("cv") if "cv" in self.models.names else -1
        out: Array = polar_kernels.estimate(state.x, state.mu, owner, sensor, self._mount, cv)
        return out

    @functools.lru_cache(maxsize=8)  # noqa: B019 (a filter lives as long as its run)
    def _transition(self, dt_s: float) -> tuple[Array, Array, Array]:
        """F, Q and Π of one time step, (1, r, …) each."""
        step = np.array([dt_s])
        return *self.models.transition(step), markov_powers(self.markov, step, self._step_s)
