"""The filters on (r, ṙ, r̈, β, β̇, β̈): `imm`, and `cv` and `ca` as IMMs of one model.

β̇ and β̈ are kept over ground: the ego's yaw is taken out as a known input, and so is the sensor's
acceleration, so that an object that does not manoeuvre looks so also from a turning or braking vehicle.
"""

import functools

import numpy as np
from pydantic import Field

from plugin.tracking import imm, imm_kernels, polar_kernels
from plugin.tracking.detections import Array, Detections, Estimate, SensorMotion
from plugin.tracking.imm import ImmState
from plugin.tracking.kalman_kernels import STATES
from plugin.tracking.models import (
    POLAR_ANGLE,
    POLAR_H,
    PolarMotion,
    RadarNoise,
    markov_powers,
    polar_models,
)
from sumo_net.settings import settings

_SEEN = np.array([0, 1, 3])  # which states are measured


@settings
class StartSpread:
    """How little is known of a new object beyond its first detection."""

    lateral_speed_mps: float = Field(2.0, gt=0, description="σ of the speed across the vehicle's axis")
    acceleration_mps2: float = Field(2.0, gt=0, description="σ of the acceleration, each axis")


def first_velocity(detections: Detections, sensor: SensorMotion, spread: float) -> tuple[Array, Array, Array]:
    """Velocity over ground (vx, vy), and σ of what the range rate does not tell, of objects first seen.

    Objects move along the road, so nearly along x: v_x = (ṙ + u·v_sensor)/cos β. Where the line of sight is
    nearly across (|cos β| < 0.5) the velocity is taken along the line of sight.
    """
    c, s = np.cos(detections.azimuth_rad), np.sin(detections.azimuth_rad)
    own = detections.owner
    radial = detections.range_rate_mps + c * sensor.vx[own] + s * sensor.vy[own]
    ahead = np.abs(c) >= 0.5
    vx = np.where(ahead, radial / np.where(ahead, c, 1.0), radial * c)
    vy = np.where(ahead, 0.0, radial * s)
    # Across the line of sight there remains v_y / cos β, or anything as fast as the object itself.
    return vx, vy, np.where(ahead, spread / np.where(ahead, np.abs(c), 1.0), spread + np.abs(radial))


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
        self._step_s, self._R, self._spread, self._mount = (
            motion.step_s,
            noise.covariance,
            spread,
            mount_forward_m,
        )

    def start(self, detections: Detections, sensor: SensorMotion) -> ImmState:
        vx, vy, sigma = first_velocity(detections, sensor, self._spread.lateral_speed_mps)
        own, r = detections.owner, np.maximum(detections.range_m, 0.1)
        c, s = np.cos(detections.azimuth_rad), np.sin(detections.azimuth_rad)
        x = np.zeros((len(own), STATES))
        x[:, 0], x[:, 1], x[:, 3] = detections.range_m, detections.range_rate_mps, detections.azimuth_rad
        x[:, 4] = (c * (vy - sensor.vy[own]) - s * (vx - sensor.vx[own])) / r
        P = np.zeros((len(own), STATES, STATES))
        P[:, _SEEN[:, None], _SEEN] = self._R
        P[:, 2, 2] = self._spread.acceleration_mps2**2
        P[:, 4, 4] = (sigma / r) ** 2
        P[:, 5, 5] = (self._spread.acceleration_mps2 / r) ** 2
        return imm.init(x, P, np.full(len(self.models.names), 1.0 / len(self.models.names)))

    def predict(self, state: ImmState, owner: Array, dt: Array, sensor: SensorMotion) -> ImmState:
        if len(dt) and dt[0] == dt.min() == dt.max():
            (F, Q, markov), which = self._transition(float(dt[0])), np.zeros(len(dt), np.int64)
        else:
            steps, which = np.unique(dt, return_inverse=True)
            F, Q = self.models.transition(steps)
            markov = markov_powers(self.markov, steps, self._step_s)
        return ImmState(*polar_kernels.predict(*state, F, Q, markov, which[owner], owner, dt, sensor))

    def expect(self, state: ImmState, owner: Array, sensor: SensorMotion) -> tuple[Array, Array]:
        expected, S = imm_kernels.expect(*state, self._R, _SEEN)
        return expected, S

    def measure(self, detections: Detections) -> Array:
        return np.stack([detections.range_m, detections.range_rate_mps, detections.azimuth_rad], axis=1)

    def update(self, state: ImmState, z: Array, seen: Array, owner: Array, sensor: SensorMotion) -> ImmState:
        imm_kernels.update(*state, z, seen, POLAR_H, self._R, POLAR_ANGLE)
        return state

    def lost(self, state: ImmState) -> Array:
        """By construction they stay non-negative; only numbers can be lost."""
        return ~np.asarray(imm_kernels.finite(state.P))

    def restart(self, state: ImmState, rows: Array) -> ImmState:
        """Covariances as of new tracks and even mode probabilities for `rows` (T,) bool."""
        P, mu = state.P.copy(), state.mu.copy()
        r = np.maximum(state.x[rows, :, 0], 1.0)
        fresh = np.zeros((*r.shape, STATES, STATES))
        fresh[..., _SEEN[:, None], _SEEN] = self._R
        fresh[..., 2, 2] = self._spread.acceleration_mps2**2
        fresh[..., 4, 4] = (self._spread.lateral_speed_mps / r) ** 2
        fresh[..., 5, 5] = (self._spread.acceleration_mps2 / r) ** 2
        P[rows], mu[rows] = fresh, 1.0 / mu.shape[1]
        return ImmState(state.x, P, mu)

    def estimate(self, state: ImmState, owner: Array, sensor: SensorMotion) -> Estimate:
        cv = self.models.names.index("cv") if "cv" in self.models.names else -1
        return Estimate(*polar_kernels.estimate(state.x, state.mu, owner, sensor, self._mount, cv))

    @functools.lru_cache(maxsize=8)  # noqa: B019 (a filter lives as long as its run)
    def _transition(self, dt_s: float) -> tuple[Array, Array, Array]:
        """F, Q and Π of one time step, (1, r, …) each."""
        step = np.array([dt_s])
        return *self.models.transition(step), markov_powers(self.markov, step, self._step_s)
