"""Kernels of the interacting-multiple-model filter over all tracks at once (IMM source, steps 1 to 4)."""

import math

import numpy as np

from plugin.tracking.block_kernels import BLOCK, Block, put, take
from plugin.tracking.block_kernels import update as update_block
from plugin.tracking.kalman_kernels import (
    LOG_TWO_PI,
    MEASURED,
    MEASURES,
    STATES,
    clear,
    copy,
    innovation,
    predict_one,
)
from sumo_net.compile import inlined, kernel
from sumo_net.scratch import scratch


@inlined
def mix(x, P, mu, markov, j, x0, P0, w):  # type: ignore[no-untyped-def]
    """Step 1: the mixed initial condition of model j into x0 (n,), P0 (n, n); gives c = Σᵢ Π[i, j] μ[i].

    x (r, n), P (r, n, n), mu (r,), markov (r, r) with Π[i, j] = P(i → j); w (r,) is scratch. A model that
    cannot be reached (c = 0) starts from its own last estimate.
    """
    r, n, d, total = len(x), STATES, scratch(STATES), 0.0
    for i in range(r):
        w[i] = markov[i, j] * mu[i]
        total += w[i]
    for i in range(r):
        w[i] = w[i] / total if total > 0.0 else (1.0 if i == j else 0.0)
    for a in range(n):
        mean = 0.0
        for i in range(r):
            mean += w[i] * x[i, a]
        x0[a] = mean
    clear(P0)
    for i in range(r):
        if w[i] > 0.0:
            for a in range(n):
                d[a] = x[i, a] - x0[a]
            for a in range(n):
                for b in range(n):
                    P0[a, b] += w[i] * (P[i, a, b] + d[a] * d[b])
    return total


@kernel
def predict(x, P, mu, F, Q, markov, which, shift):  # type: ignore[no-untyped-def]
    """Mixing and prediction: x (T, r, n), P (T, r, n, n), mu (T, r); F, Q (U, r, n, n), markov (U, r, r),
    which (T,) into U, shift (T, n) added after F. The mode probabilities returned are the predicted ones.
    """
    tracks, r = len(x), x.shape[1]
    xp, Pp, c = np.empty_like(x), np.empty_like(P), np.empty_like(mu)
    x0, P0, w = scratch(STATES), scratch((STATES, STATES)), np.empty(r)
    for t in range(tracks):
        u = which[t]
        for j in range(r):
            c[t, j] = mix(x[t], P[t], mu[t], markov[u], j, x0, P0, w)
            predict_one(x0, P0, F[u, j], Q[u, j], shift[t], xp[t, j], Pp[t, j])
    return xp, Pp, c


@kernel
def update(x, P, mu, z, chosen, R, angle):  # type: ignore[no-untyped-def]
    """Steps 2 and 3 in place: every model's update, and the mode probabilities by their log-likelihoods.

    Shapes as in `predict`; z (D, m), chosen (T,) the row of z that a track takes, -1 for none, R (m, m),
    angle (m,). The probabilities are taken relative to the likeliest mode, so that they cannot all
    underflow. A track without a measurement stays as predicted. Where some model's innovation covariance is
    not positive definite, `sound` (T,), which is returned, is False and the probabilities stay as
    predicted.
    """
    tracks, r = len(chosen), x.shape[1]
    sound, log_likelihood = np.ones(tracks, np.bool_), np.empty((tracks, r))
    y, one_R, places, used = scratch(MEASURED), scratch((MEASURED, MEASURED)), np.empty(BLOCK, np.int64), 0
    block = Block(
        scratch((STATES, BLOCK)), scratch((STATES, STATES, BLOCK)), scratch((MEASURED, BLOCK)),
        scratch(BLOCK), scratch(BLOCK),
    )  # fmt: skip
    copy(R, one_R)
    for one in range(tracks * r):
        t, j = one // r, one % r
        if chosen[t] >= 0:
            innovation(x[t, j], z[chosen[t]], angle, y)
            put(block, used, x[t, j], P[t, j], y)
            places[used] = one
            used += 1
        if used == BLOCK or one == tracks * r - 1:
            update_block(block, used, one_R)
            for place in range(used):
                t, j = places[place] // r, places[place] % r
                squared, determinant = block.squared[place], block.determinant[place]
                likelihood = -0.5 * (MEASURED * LOG_TWO_PI + squared) - math.log(determinant)
                log_likelihood[t, j] = likelihood
                if math.isnan(likelihood):
                    sound[t] = False
                else:
                    take(block, place, x[t, j], P[t, j])
            used = 0
    for t in range(tracks):
        if chosen[t] >= 0 and sound[t]:
            weigh(log_likelihood[t], mu[t])
    return sound


@inlined
def weigh(log_likelihood, mu):  # type: ignore[no-untyped-def]
    """Step 3 in place: mode probabilities mu (r,) by the models' log-likelihoods (r,), overwritten."""
    r, highest, total = len(mu), -math.inf, 0.0
    for j in range(r):
        log_likelihood[j] += math.log(mu[j]) if mu[j] > 0.0 else -math.inf
        highest = max(highest, log_likelihood[j])
    for j in range(r):
        mu[j] = math.exp(log_likelihood[j] - highest)
        total += mu[j]
    for j in range(r):
        mu[j] /= total


@kernel
def combine(x, P, mu):  # type: ignore[no-untyped-def]
    """Step 4: mean (T, n) and covariance (T, n, n) of the mixture, with the spread of the means."""
    tracks, r, n = len(x), x.shape[1], STATES
    mean, covariance = np.zeros((tracks, n)), np.empty((tracks, n, n))
    M, d = scratch((STATES, STATES)), scratch(STATES)
    for t in range(tracks):
        for j in range(r):
            for a in range(n):
                mean[t, a] += mu[t, j] * x[t, j, a]
        clear(M)
        for j in range(r):
            weight = mu[t, j]
            if weight > 0.0:
                for a in range(n):
                    d[a] = x[t, j, a] - mean[t, a]
                for a in range(n):
                    for b in range(n):
                        M[a, b] += weight * (P[t, j, a, b] + d[a] * d[b])
        copy(M, covariance[t])
    return mean, covariance


@kernel
def expect(tracks, x, P, mu, R):  # type: ignore[no-untyped-def]
    """Mean (T, m) and covariance (T, m, m) of the next measurement: H applied to `combine`, plus R.

    For the first `tracks` = T rows of x, P, mu.
    """
    r, m = x.shape[1], MEASURED
    mean, S = np.zeros((tracks, m)), np.zeros((tracks, m, m))
    for t in range(tracks):
        for j in range(r):
            for a in range(m):
                mean[t, a] += mu[t, j] * x[t, j, MEASURES[a]]
        for j in range(r):
            weight = mu[t, j]
            if weight > 0.0:
                for a in range(m):
                    for b in range(m):
                        spread = (x[t, j, MEASURES[a]] - mean[t, a]) * (x[t, j, MEASURES[b]] - mean[t, b])
                        S[t, a, b] += weight * (P[t, j, MEASURES[a], MEASURES[b]] + spread)
        for a in range(m):
            for b in range(m):
                S[t, a, b] += R[a, b]
    return mean, S
