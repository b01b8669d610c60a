"""The interacting-multiple-model filter (IMM source, section 3), general in the number of models.

With one model it is the plain Kalman filter. Mode probabilities are updated as logarithms; without a
measurement they change by the Markov step alone.
"""

from typing import NamedTuple

import numpy as np

from plugin.tracking import imm_kernels as kernels
from plugin.tracking import kalman_kernels
from plugin.tracking.kalman import Gaussian, check_measured, check_states
from sumo_net.arrays import Array


class ImmState(NamedTuple):
    """T tracks, r models, n = 6 states."""

    x: Array  # (T, r, n)
    P: Array  # (T, r, n, n)
    mu: Array  # (T, r) mode probabilities


def init(x: Array, P: Array, mu: Array) -> ImmState:
    """Every model of a track at x (T, n), P (T, n, n), with mode probabilities mu (r,)."""
    tracks, r = len(x), len(mu)
    return ImmState(
        np.repeat(x[:, None], r, axis=1),
        np.repeat(P[:, None], r, axis=1),
        np.tile(np.asarray(mu, np.float64), (tracks, 1)),
    )


def markov_of(stay: float, r: int) -> Array:
    """Π (r, r) of models that are kept with probability `stay`; all others are equally likely to follow."""
    markov = np.full((r, r), (1.0 - stay) / max(r - 1, 1))
    np.fill_diagonal(markov, stay if r > 1 else 1.0)
    return markov


def check_markov(markov: Array, r: int) -> Array:
    """Π as a float (r, r) array. Raises ValueError where it is not stochastic: Π[i, j] = P(i → j)."""
    markov = np.asarray(markov, np.float64)
    rows_sum_to_one = markov.shape == (r, r) and np.allclose(markov.sum(axis=1), 1.0, atol=1e-9)
    if not rows_sum_to_one or np.any(markov < 0.0):
        raise ValueError(
            f"markov = {markov.tolist()}: must be {r} rows of {r} probabilities, each summing to 1"
        )
    return markov


def predict(
    state: ImmState,
    F: Array,
    Q: Array,
    markov: Array,
    which: Array | None = None,
    shift: Array | None = None,
) -> ImmState:
    """Step 1 and the prediction of step 2; mu becomes the predicted mode probabilities.

    Parameters
    ----------
    F, Q : (U, r, n, n) arrays.
    markov : (U, r, r) array, Π[u, i, j] = P(i → j).
    which : (T,) int64, the row of F, Q and markov each track takes; 0 if left out.
    shift : (T, n) known input, 0 if left out.
    """
    tracks, n = check_states(state.x)
    which = np.zeros(tracks, np.int64) if which is None else which
    shift = np.zeros((tracks, n)) if shift is None else shift
    if state.x.shape[1] == 1:  # nothing to mix
        x, P = kalman_kernels.predict(state.x[:, 0], state.P[:, 0], F[:, 0], Q[:, 0], which, shift)
        return ImmState(x[:, None], P[:, None], markov[which, 0] * state.mu)
    return ImmState(*kernels.predict(*state, F, Q, markov, which, shift))


def update(
    state: ImmState,
    z: Array,
    seen: Array,
    R: Array,
    angle: Array | None = None,
    out: ImmState | None = None,
) -> tuple[ImmState, Array]:
    """Steps 2 and 3 with z (T, m) where `seen` (T,).

    out : receives the new state, may be `state` itself; new arrays if left out.

    Gives the state and `sound` (T,) bool: False where an innovation covariance was not positive definite.
    """
    check_states(state.x)
    check_measured(z)
    angle = np.zeros(kalman_kernels.MEASURED, np.bool_) if angle is None else angle
    if out is None:
        out = ImmState(*(part.copy() for part in state))
    elif out is not state:
        for part, before in zip(out, state, strict=True):
            part[...] = before
    chosen = np.where(seen, np.arange(len(z)), -1)
    return out, kernels.update(*out, z, chosen, R, angle)


def combine(state: ImmState) -> Gaussian:
    """Step 4: mean and covariance of the mixture; those of the model if there is only one."""
    if state.mu.shape[1] == 1:
        return Gaussian(state.x[:, 0], state.P[:, 0])
    return Gaussian(*kernels.combine(*state))
