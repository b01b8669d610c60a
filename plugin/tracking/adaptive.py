"""The adaptive Kalman filter (Sage–Husa; CN104635233A eqs. 8 to 14) over all tracks at once.

`safe` adapts R in the residual form, which keeps R positive definite. `patent` is the published recursion:
it subtracts covariances from squared innovations and so loses definiteness; this is flagged, not repaired.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from plugin.tracking import adaptive_kernels as kernels
from plugin.tracking import kalman
from plugin.tracking.kalman_kernels import MEASURED, STATES
from sumo_net.arrays import Array
from sumo_net.settings import settings

R_INDEFINITE, Q_INDEFINITE, P_INDEFINITE = kernels.R_INDEFINITE, kernels.Q_INDEFINITE, kernels.P_INDEFINITE
S_INDEFINITE, NOT_FINITE = kernels.S_INDEFINITE, kernels.NOT_FINITE


@settings
class Adaptation:
    """How fast the noise estimates forget."""

    forgetting: float = Field(0.97, gt=0.5, lt=1, description="b of d_k = (1 − b)/(1 − b^{k+1})")
    prior_steps: float = Field(3.0, ge=0, description="safe form: weight of the initial R, in measurements")
    adapt_process: bool = Field(True, description="patent: adapt q, Q and r as well as R")


class AdaptiveState(NamedTuple):
    """T tracks, n = 6 states, m = 3 measured."""

    x: Array  # (T, n)
    P: Array  # (T, n, n)
    q: Array  # (T, n) mean of the process noise
    Q: Array  # (T, n, n) its covariance, for one step (patent only)
    r: Array  # (T, m) mean of the measurement noise
    R: Array  # (T, m, m) its covariance
    k: Array  # (T,) measurements used so far, plus the weight of the initial R
    flags: Array  # (T,) int64, which matrices the last update made indefinite; 0 in the safe form


def init(x: Array, P: Array, R: Array, Q: Array, prior_steps: float = 0.0) -> AdaptiveState:
    """States from x (T, n), P (T, n, n), with R (m, m) and, for the patent's form, Q (n, n) to start from."""
    tracks, n = x.shape
    m = len(R)
    return AdaptiveState(
        x,
        P,
        np.zeros((tracks, n)),
        np.tile(Q, (tracks, 1, 1)),
        np.zeros((tracks, m)),
        np.tile(R, (tracks, 1, 1)),
        np.full(tracks, float(prior_steps)),
        np.zeros(tracks, np.int64),
    )


def predict_safe(
    state: AdaptiveState, F: Array, Q: Array, which: Array | None = None, shift: Array | None = None
) -> AdaptiveState:
    """Prediction with the model's own Q; arguments as in `kalman.predict`."""
    x, P = kalman.predict(kalman.Gaussian(state.x, state.P), F, Q, which, shift)
    return state._replace(x=x, P=P)


def predict_patent(
    state: AdaptiveState, F: Array, which: Array | None = None, shift: Array | None = None
) -> AdaptiveState:
    """Eqs. (8) and (9) with the estimates q̂ and Q̂, which hold for one step whatever its length."""
    known = state.q if shift is None else state.q + shift
    x, P = kalman.predict(kalman.Gaussian(state.x, state.P), F, np.zeros(state.P.shape[1:]), which, known)
    return state._replace(x=x, P=P + state.Q)


def update_safe(state: AdaptiveState, z: Array, seen: Array, H: Array, forgetting: float) -> AdaptiveState:
    """Update with z (T, m) where `seen` (T,), and R's adaptation; H (m, n), or (T, m, n) by track."""
    H, which = _rows(H, len(z))
    x, P, R, k = kernels.update_safe(state.x, state.P, state.R, state.k, z, seen, H, which, forgetting)
    return state._replace(x=x, P=P, R=R, k=k)


def update_patent(
    state: AdaptiveState, z: Array, seen: Array, H: Array, forgetting: float, adapt_process: bool
) -> AdaptiveState:
    """Eqs. (10) to (14) as published; `flags` says what was lost. Arguments as in `update_safe`."""
    H, which = _rows(H, len(z))
    return AdaptiveState(*kernels.update_patent(*state[:7], z, seen, H, which, forgetting, adapt_process))


def innovation_covariance(state: AdaptiveState, H: Array) -> tuple[Array, Array]:
    """S (T, m, m) before an update, and whether each is positive definite (T,)."""
    H, which = _rows(H, len(state.x))
    S, definite = kernels.measurement_covariance(state.P, state.R, H, which)
    return S, definite


def _rows(H: Array, tracks: int) -> tuple[Array, Array]:
    if H.shape[-2:] != (MEASURED, STATES):
        raise ValueError(f"H is {H.shape[-2:]}: the kernels take {(MEASURED, STATES)}")
    if H.ndim == 2:
        return H[None], np.zeros(tracks, np.int64)
    return H, np.arange(tracks)
