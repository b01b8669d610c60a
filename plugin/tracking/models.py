"""Motion and measurement models of radar tracking, for any time step.

A kinematic chain is linear with a nilpotent derivative, so F(dt) and Q(dt) are polynomials in dt; a model
stores their coefficients, and one call gives the matrices of all U different time steps.

Polar (IMM source, section 4): state (r, ṙ, r̈, β, β̇, β̈), z = (r, ṙ, β). Over ground (CN104635233A, eqs. 4 to
7): state (x, ẋ, ẍ, y, ẏ, ÿ), z = (x, v_r, y).
"""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field
from scipy.linalg import block_diag, fractional_matrix_power

from plugin.tracking.kalman_kernels import MEASURES, STATES
from sumo_net.arrays import Array
from sumo_net.settings import settings

POLAR_H = np.eye(STATES)[list(MEASURES)]
POLAR_ANGLE = np.array([False, False, True])
GROUND_C = np.eye(STATES)[list(MEASURES)]  # eq. (6)


@settings
class RadarNoise:
    """Standard deviations of one detection (IMM source, section 4; the scan prints other units)."""

    range_m: float = Field(1.0, gt=0, description="σ₁, of the range")
    range_rate_mps: float = Field(0.5, gt=0, description="σ₂, of the range rate")
    azimuth_rad: float = Field(math.radians(0.2), gt=0, description="σ₃, of the azimuth; 0.2°")

    @property
    def covariance(self) -> Array:
        """(3, 3) covariance of (r, ṙ, β)."""
        return np.diag([self.range_m**2, self.range_rate_mps**2, self.azimuth_rad**2])


@settings
class PolarMotion:
    """Process noise of the polar models, as the source states it: per step of `step_s`."""

    acceleration_mps2: float = Field(
        0.8, gt=0, description="σ_α, along the line of sight; the source's 0.3 is too small for hard braking"
    )
    angular_acceleration_rps2: float = Field(math.radians(0.3), gt=0, description="σ_β, 0.3 °/s²")
    step_s: float = Field(0.1, gt=0, description="the time step for which both are stated")


PUBLISHED_MOTION = PolarMotion(acceleration_mps2=0.3)


@settings
class GroundMotion:
    """Process noise of the model over ground (eq. 4): white jerk on each axis."""

    forward_jerk_mps3: float = Field(3.0, gt=0, description="σ of the jerk over one step, along x")
    left_jerk_mps3: float = Field(1.5, gt=0, description="σ of the jerk over one step, along y")
    step_s: float = Field(0.1, gt=0, description="the time step for which both are stated")


class Models(NamedTuple):
    """r linear models of one state of n components."""

    F: Array  # (r, D, n, n): F(dt) = Σ_d F[d] dt^d
    Q: Array  # (r, E, n, n): Q(dt) = Σ_e Q[e] dt^e
    names: tuple[str, ...]

    def transition(self, dt: Array) -> tuple[Array, Array]:
        """F(dt) and Q(dt), (U, r, n, n) each, for time steps dt (U,) in s."""
        powers = np.power.outer(np.asarray(dt, dtype=np.float64), np.arange(self.Q.shape[1]))
        F = np.einsum("ud,rdij->urij", powers[:, : self.F.shape[1]], self.F)
        return F, np.einsum("ue,reij->urij", powers, self.Q)


def polar_models(kinds: tuple[str, ...], motion: PolarMotion) -> Models:
    """The models of the IMM source by name, "cv" (constant velocity) or "ca" (constant acceleration).

    Noise at dt = step_s is the discrete white noise Γ Γᵀ σ² with Γ = (dt²/2, dt, 1): in cv σ is an
    acceleration held over the step, in ca the acceleration's change at the step. At any other dt it is scaled
    so that the variance of the highest driven state grows by as much a second. cv keeps r̈ and β̈ at zero.
    """
    unknown = set(kinds) - {"cv", "ca"}
    if unknown or not kinds:
        raise ValueError(f"models = {kinds!r}: allowed are 'cv' and 'ca'")
    variances = (motion.acceleration_mps2**2, motion.angular_acceleration_rps2**2)
    F, Q = zip(*(_chain(kind, motion.step_s, variances) for kind in kinds), strict=True)
    return Models(np.stack(F), np.stack(Q), tuple(kinds))


def ground_model(motion: GroundMotion) -> Models:
    """The one model of eqs. (4) and (5): Φ of (x, ẋ, ẍ), Γ = (dt³/6, dt²/2, dt) for the jerk of one step."""
    F, _ = _chain("ca", motion.step_s, (1.0, 1.0))
    Q = np.zeros((7, STATES, STATES))
    gamma, power = (1 / 6, 1 / 2, 1.0), (3, 2, 1)
    for axis, sigma in enumerate((motion.forward_jerk_mps3, motion.left_jerk_mps3)):
        for i in range(3):
            for j in range(3):
                # white jerk over steps: the variance of its integral grows by σ² step_s per second
                e = power[i] + power[j] - 1
                Q[e, 3 * axis + i, 3 * axis + j] = gamma[i] * gamma[j] * sigma**2 * motion.step_s
    return Models(F[None], Q[None], ("ca",))


def markov_powers(markov: Array, dt: Array, step_s: float) -> Array:
    """Π(dt) (U, r, r) from Π (r, r), Π[i, j] = P(i → j), that is stated for `step_s`."""
    out = np.empty((len(dt), *markov.shape))
    for u, one in enumerate(dt):
        if abs(one - step_s) < 1e-9 * step_s:
            out[u] = markov
            continue
        power = np.clip(np.real(fractional_matrix_power(markov, one / step_s)), 0.0, None)
        out[u] = power / power.sum(axis=1, keepdims=True)
    return out


def _chain(kind: str, step_s: float, variances: tuple[float, ...]) -> tuple[Array, Array]:
    """Coefficients F (3, n, n), Q (7, n, n) of one chain of three states per axis."""
    F, Q = np.zeros((3, STATES, STATES)), np.zeros((7, STATES, STATES))
    axes = len(variances)
    derivative = np.diag([1.0, 1.0], 1)
    if kind == "cv":
        derivative[1, 2] = 0.0
    F[0] = block_diag(*[np.diag([1.0, 1.0, float(kind == "ca")])] * axes)
    F[1] = block_diag(*[derivative] * axes)
    F[2] = block_diag(*[derivative @ derivative / 2] * axes)
    gamma = np.array([0.5, 1.0, float(kind == "ca")])
    # Powers of dt in Γ Γᵀ are 4 − i − j; per second, cv's variance of ṙ is σ² step_s, ca's of r̈ σ²/step_s.
    extra, rate = (1, 1 / step_s) if kind == "ca" else (-1, step_s)
    for i in range(3):
        for j in range(3):
            weight = gamma[i] * gamma[j] * rate
            if weight:
                Q[4 - i - j + extra, i::3, j::3] += np.diag([weight * v for v in variances])
    return F, Q
