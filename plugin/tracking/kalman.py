"""The Kalman filter over all tracks at once, each with its own time step and with missing measurements."""

from typing import NamedTuple

import numpy as np

from plugin.tracking import kalman_kernels as kernels
from sumo_net.arrays import Array


class Gaussian(NamedTuple):
    """State estimates of T tracks with n = 6 states."""

    x: Array  # (T, n)
    P: Array  # (T, n, n)


class Innovation(NamedTuple):
    """Measurement minus prediction; NaN without a measurement."""

    y: Array  # (T, m)
    S: Array  # (T, m, m)
    log_likelihood: Array  # (T,); NaN also where S was not positive definite, which skips the update


def check_states(x: Array) -> tuple[int, int]:
    """(T, n) of states x (T, ..., n). Raises ValueError unless n is what the kernels are compiled for."""
    if x.shape[-1] != kernels.STATES:
        raise ValueError(f"x has {x.shape[-1]} states: the kernels take {kernels.STATES}")
    return len(x), x.shape[-1]


def check_measured(z: Array) -> None:
    """Raises ValueError unless z (T, m) is of the size that the kernels are compiled for."""
    if z.shape[-1] != kernels.MEASURED:
        raise ValueError(f"z has {z.shape[-1]} components: the kernels take {kernels.MEASURED}")


def predict(
    state: Gaussian, F: Array, Q: Array, which: Array | None = None, shift: Array | None = None
) -> Gaussian:
    """x ← F x + shift, P ← F P Fᵀ + Q.

    Parameters
    ----------
    F, Q : (U, n, n) arrays, or (n, n) if the same for all U.
    which : (T,) int64, the row of F and Q each track takes; may be left out if U is 1 or T.
    shift : (T, n) known input, 0 if left out.
    """
    tracks, n = check_states(state.x)
    F, Q = F.reshape(-1, n, n), Q.reshape(-1, n, n)
    rows = max(len(F), len(Q))
    F, Q = (np.repeat(M, rows, axis=0) if len(M) < rows else np.ascontiguousarray(M) for M in (F, Q))
    if which is None:
        which = np.zeros(tracks, np.int64) if len(F) == 1 else np.arange(tracks)
    shift = np.zeros((tracks, n)) if shift is None else shift
    return Gaussian(*kernels.predict(state.x, state.P, F, Q, which, shift))


def update(
    state: Gaussian, z: Array, seen: Array, R: Array, angle: Array | None = None
) -> tuple[Gaussian, Innovation]:
    """Joseph-form update with z (T, m) where `seen` (T,); R (m, m), angle (m,) bool or none.

    z holds the states `kalman_kernels.MEASURES`.
    """
    check_states(state.x)
    check_measured(z)
    angle = np.zeros(kernels.MEASURED, np.bool_) if angle is None else angle
    x, P, *innovation = kernels.update(state.x, state.P, z, seen, R, angle)
    return Gaussian(x, P), Innovation(*innovation)
