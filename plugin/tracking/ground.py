"""The filters over ground: `adaptive` and `patent` on (x, ẋ, ẍ, y, ẏ, ÿ), z = (x, v_r, y) (eqs. 4 to 15).

Position is from the radar, in the axes of the vehicle now; velocity and acceleration are over ground in the
same axes: the prediction subtracts the radar's displacement and turns by the ego's yaw, extending eqs. (1) to
(3) to a turning vehicle. v_r is the speed along the line of sight, which row 2 of eq. (6) takes for ẋ, exact
straight ahead; here the row is (cos β, sin β) on (ẋ, ẏ). The update runs along and across the line of sight,
an invertible map of (x, v_r, y), because there the radar's noise is uniform and R can be adapted.
"""

import numpy as np

from plugin.tracking import adaptive
from plugin.tracking.adaptive import Adaptation, AdaptiveState
from plugin.tracking.detections import Detections, SensorMotion
from plugin.tracking.kalman_kernels import STATES
from plugin.tracking.models import GroundMotion, RadarNoise, ground_model
from plugin.tracking.polar import StartSpread, first_velocity
from sumo_net.arrays import Array
from sumo_net.batch import join, select


class GroundFilter:
    """Sage–Husa over ground; with `published` the recursion as published, else the safe form."""

    angle = np.zeros(3, np.bool_)

    def __init__(
        self,
        published: bool,
        adaptation: Adaptation,
        motion: GroundMotion,
        noise: RadarNoise,
        spread: StartSpread,
        mount_forward_m: float,
    ) -> None:
        self.published, self.adaptation = published, adaptation
        self._model, self._R, self._spread, self._mount = (
            ground_model(motion),
            noise.covariance,
            spread,
            mount_forward_m,
        )
        self._Q = self._model.transition(np.array([motion.step_s]))[1][0, 0]

    def start(self, detections: Detections, sensor: SensorMotion) -> AdaptiveState:
        r, azimuth = np.maximum(detections.range_m, 0.1), detections.azimuth_rad
        tracks, c, s = len(r), np.cos(azimuth), np.sin(azimuth)
        vx, vy, sigma = first_velocity(detections, c, s, sensor, self._spread)
        x = np.zeros((tracks, STATES))
        x[:, 0], x[:, 1], x[:, 3], x[:, 4] = r * c, vx, r * s, vy
        along = (self._R[0, 0], self._R[1, 1], self._spread.acceleration_mps2**2)
        across = (self._R[2, 2] * r**2, sigma**2, self._spread.acceleration_mps2**2)
        P = np.zeros((tracks, STATES, STATES))
        for i in range(3):
            P[:, i, i] = along[i] * c**2 + across[i] * s**2
            P[:, 3 + i, 3 + i] = along[i] * s**2 + across[i] * c**2
            P[:, i, 3 + i] = P[:, 3 + i, i] = (along[i] - across[i]) * c * s
        prior = 0.0 if self.published else self.adaptation.prior_steps
        return adaptive.init(x, P, self._R, self._Q, prior)

    def join(self, state: AdaptiveState, tracks: int, new: AdaptiveState) -> AdaptiveState:
        return join(state, new)

    def predict(
        self, state: AdaptiveState, rows: Array, owner: Array, dt: Array, sensor: SensorMotion, room: int
    ) -> tuple[AdaptiveState, Array]:
        """Reports as lost the tracks whose last update left a matrix indefinite; none in the safe form."""
        state = select(state, rows)
        steps, which = np.unique(dt, return_inverse=True)
        F, Q = (m[:, 0] for m in self._model.transition(steps))
        turn = np.zeros((len(dt), STATES, STATES))
        c, s, axis = np.cos(sensor.yaw_rate * dt), np.sin(sensor.yaw_rate * dt), np.arange(3)
        turn[:, axis, axis] = turn[:, axis + 3, axis + 3] = c[:, None]
        turn[:, axis, axis + 3] = s[:, None]
        turn[:, axis + 3, axis] = -s[:, None]
        way = np.zeros((len(dt), STATES))
        way[:, 0] = -(sensor.vx + 0.5 * sensor.ax * dt) * dt
        way[:, 3] = -(sensor.vy + 0.5 * sensor.ay * dt) * dt
        F, shift = turn @ F[which], np.einsum("nij,nj->ni", turn, way)[owner]
        if self.published:
            state = adaptive.predict_patent(state, F, owner, shift)
        else:
            state = adaptive.predict_safe(state, F, Q[which], owner, shift)
        return state, state.flags != 0

    def expect(self, state: AdaptiveState, owner: Array, sensor: SensorMotion) -> tuple[Array, Array]:
        r, c, s = _line_of_sight(state.x)
        S, _ = adaptive.innovation_covariance(state, _rows(r, c, s))
        J = np.zeros((len(r), 3, 3))
        J[:, 0, 0], J[:, 0, 2], J[:, 1, 1], J[:, 2, 0], J[:, 2, 2] = c, -r * s, 1.0, s, r * c
        x = state.x
        rate = c * (x[:, 1] - sensor.vx[owner]) + s * (x[:, 4] - sensor.vy[owner])
        return np.stack([x[:, 0], rate, x[:, 3]], axis=1), J @ S @ J.transpose(0, 2, 1)

    def measure(self, detections: Detections) -> Array:
        r, azimuth = detections.range_m, detections.azimuth_rad
        return np.stack([r * np.cos(azimuth), detections.range_rate_mps, r * np.sin(azimuth)], axis=1)

    def update(
        self, state: AdaptiveState, z: Array, chosen: Array, owner: Array, sensor: SensorMotion
    ) -> AdaptiveState:
        seen = chosen >= 0
        z = z[chosen] if len(z) else np.zeros((len(chosen), 3))
        r, c, s = _line_of_sight(state.x)
        turned = np.stack(
            [
                c * z[:, 0] + s * z[:, 2],
                z[:, 1] + c * sensor.vx[owner] + s * sensor.vy[owner],
                (c * z[:, 2] - s * z[:, 0]) / r,
            ],
            axis=1,
        )
        H, b = _rows(r, c, s), self.adaptation.forgetting
        if self.published:
            return adaptive.update_patent(state, turned, seen, H, b, self.adaptation.adapt_process)
        return adaptive.update_safe(state, turned, seen, H, b)

    def restart(self, state: AdaptiveState, lost: Array) -> AdaptiveState:
        """Reset what the tracks `lost` (T,) bool have lost: R with r, Q with q, P; k stays.

        (With k = 0, d = 1 would replace R by the next squared innovation alone, and lose it again.) A track
        of `lost` without flags has lost S: everything is reset.
        """
        flags = np.where(state.flags == 0, -1, state.flags)
        fresh = adaptive.init(state.x, np.tile(self._wide(), (len(lost), 1, 1)), self._R, self._Q)
        parts = state._asdict()
        all_lost = adaptive.S_INDEFINITE | adaptive.NOT_FINITE
        for told, names in (
            (adaptive.R_INDEFINITE, ("R", "r")),
            (adaptive.Q_INDEFINITE, ("Q", "q")),
            (adaptive.P_INDEFINITE, ("P",)),
        ):
            begun = lost & ((flags & (told | all_lost)) != 0)
            for name in names:
                old, new = parts[name], getattr(fresh, name)
                parts[name] = np.where(begun.reshape(-1, *(1,) * (old.ndim - 1)), new, old)
        parts["flags"] = np.where(lost, 0, state.flags)
        return AdaptiveState(**parts)

    def estimate(self, state: AdaptiveState, owner: Array, sensor: SensorMotion) -> Array:
        r, c, s = _line_of_sight(state.x)
        x, vx, ax, y, vy, ay = state.x.T
        rate = c * (vx - sensor.vx[owner]) + s * (vy - sensor.vy[owner])
        no_mode = np.full(len(r), np.nan)
        return np.stack([r, rate, np.arctan2(y, x), x + self._mount, y, vx, vy, ax, ay, no_mode])

    def _wide(self) -> Array:
        a = self._spread.acceleration_mps2**2
        return np.diag([4 * self._R[0, 0], 4 * self._R[1, 1], a, 4.0, self._spread.lateral_speed_mps**2, a])


def _line_of_sight(x: Array) -> tuple[Array, Array, Array]:
    """Range, cosine and sine of the azimuth of the states x (T, 6)."""
    r = np.maximum(np.hypot(x[:, 0], x[:, 3]), 1e-3)
    return r, x[:, 0] / r, x[:, 3] / r


def _rows(r: Array, c: Array, s: Array) -> Array:
    """H (T, 3, 6) of (range, speed along the line of sight, angle across it)."""
    H = np.zeros((len(r), 3, STATES))
    H[:, 0, 0], H[:, 0, 3], H[:, 1, 1], H[:, 1, 4], H[:, 2, 0], H[:, 2, 3] = c, s, c, s, -s / r, c / r
    return H
