"""Kernels of the interacting-multiple-model filter over all tracks at once (IMM source, steps 1 to 4)."""

import math

import numpy as np

from plugin.tracking.kalman_kernels import MEASURED, STATES, predict_one, update_one
from sumo_net.compile import inlined, kernel
from sumo_net.frames import wrap_angle


@inlined
def mix_one(x, P, mu, markov, x0, P0, c, w):  # type: ignore[no-untyped-def]
    """Step 1: the mixed initial conditions of each model and c[j] = Σᵢ Π[i, j] μ[i].

    x (r, n), P (r, n, n), mu (r,), markov (r, r) with Π[i, j] = P(i → j); w (r,) is scratch. A model that
    cannot be reached (c = 0) starts from its own last estimate.
    """
    r, n = len(x), STATES
    for j in range(r):
        total = 0.0
        for i in range(r):
            w[i] = markov[i, j] * mu[i]
            total += w[i]
        c[j] = total
        for i in range(r):
            w[i] = w[i] / total if total > 0.0 else (1.0 if i == j else 0.0)
        for a in range(n):
            mean = 0.0
            for i in range(r):
                mean += w[i] * x[i, a]
            x0[j, a] = mean
        for a in range(n):
            for b in range(a, n):
                total = 0.0
                for i in range(r):
                    if w[i] > 0.0:
                        total += w[i] * (P[i, a, b] + (x[i, a] - x0[j, a]) * (x[i, b] - x0[j, b]))
                P0[j, a, b] = total
                P0[j, b, a] = total


@kernel
def predict(x, P, mu, F, Q, markov, which, shift):  # type: ignore[no-untyped-def]
    """Mixing and prediction: x (T, r, n), P (T, r, n, n), mu (T, r); F, Q (U, r, n, n), markov (U, r, r),
    which (T,) into U, shift (T, n) added after F. The mode probabilities that come back are the Markov step.
    """
    tracks, r, n = len(x), x.shape[1], STATES
    xp, Pp, c = np.empty_like(x), np.empty_like(P), np.empty_like(mu)
    x0, P0, w, work = np.empty((r, n)), np.empty((r, n, n)), np.empty(r), np.empty((n, n))
    for t in range(tracks):
        u = which[t]
        mix_one(x[t], P[t], mu[t], markov[u], x0, P0, c[t], w)
        for j in range(r):
            predict_one(x0[j], P0[j], F[u, j], Q[u, j], shift[t], xp[t, j], Pp[t, j], work)
    return xp, Pp, c


@inlined
def _innovation(x, z, H, angle, y):  # type: ignore[no-untyped-def]
    """y = z − H x (m,), angles wrapped."""
    for i in range(MEASURED):
        total = z[i]
        for k in range(STATES):
            total -= H[i, k] * x[k]
        y[i] = wrap_angle(total) if angle[i] else total


@kernel
def update(x, P, mu, z, chosen, H, R, angle):  # type: ignore[no-untyped-def]
    """Steps 2 and 3 in place: every model's update, and the mode probabilities by their log-likelihoods.

    Shapes as in `predict`; z (D, m), chosen (T,) the row of z that a track takes, -1 for none, H (m, n),
    R (m, m), angle (m,). The probabilities are taken relative to the likeliest mode, so that no underflow of
    all of them can occur. Where nothing is taken all stays as predicted. Where some model's innovation
    covariance is not positive definite, `sound` (T,), which is given back, is False and the probabilities
    stay as predicted.
    """
    tracks, r, n = len(chosen), x.shape[1], STATES
    m = MEASURED
    sound = np.ones(tracks, np.bool_)
    y, K, S, L = np.empty(m), np.empty((n, m)), np.empty((m, m)), np.empty((m, m))
    A, work, log_mu = np.empty((n, n)), np.empty((n, n)), np.empty(r)
    one_x, one_P = np.empty(n), np.empty((n, n))
    for t in range(tracks):
        if chosen[t] < 0:
            continue
        highest = -math.inf
        for j in range(r):
            for a in range(n):
                one_x[a] = x[t, j, a]
                for b in range(n):
                    one_P[a, b] = P[t, j, a, b]
            _innovation(one_x, z[chosen[t]], H, angle, y)
            log_likelihood = update_one(one_x, one_P, y, H, R, K, S, L, A, work)
            if math.isnan(log_likelihood):
                sound[t] = False
            for a in range(n):
                x[t, j, a] = one_x[a]
                for b in range(n):
                    P[t, j, a, b] = one_P[a, b]
            log_mu[j] = log_likelihood + (math.log(mu[t, j]) if mu[t, j] > 0.0 else -math.inf)
            highest = max(highest, log_mu[j])
        if not sound[t]:
            continue
        total = 0.0
        for j in range(r):
            mu[t, j] = math.exp(log_mu[j] - highest)
            total += mu[t, j]
        for j in range(r):
            mu[t, j] /= total
    return sound


@kernel
def combine(x, P, mu):  # type: ignore[no-untyped-def]
    """Step 4: mean (T, n) and covariance (T, n, n) of the mixture, with the spread of the means."""
    tracks, r, n = len(x), x.shape[1], STATES
    mean, covariance = np.zeros((tracks, n)), np.zeros((tracks, n, n))
    for t in range(tracks):
        for j in range(r):
            for a in range(n):
                mean[t, a] += mu[t, j] * x[t, j, a]
        for j in range(r):
            weight = mu[t, j]
            if weight > 0.0:
                for a in range(n):
                    for b in range(a, n):
                        spread = (x[t, j, a] - mean[t, a]) * (x[t, j, b] - mean[t, b])
                        covariance[t, a, b] += weight * (P[t, j, a, b] + spread)
        for a in range(n):
            for b in range(a):
                covariance[t, a, b] = covariance[t, b, a]
    return mean, covariance


@kernel
def expect(tracks, x, P, mu, R, seen):  # type: ignore[no-untyped-def]
    """Mean (T, m) and covariance (T, m, m) of what will be measured: the mixture's states `seen` (m,) with R.

    Of the first `tracks` = T rows of x, P, mu.
    Where z is some of the states, H selecting them, this is H of `combine` with R added.
    """
    r, m = x.shape[1], MEASURED
    mean, S = np.zeros((tracks, m)), np.zeros((tracks, m, m))
    for t in range(tracks):
        for j in range(r):
            for a in range(m):
                mean[t, a] += mu[t, j] * x[t, j, seen[a]]
        for j in range(r):
            weight = mu[t, j]
            if weight > 0.0:
                for a in range(m):
                    for b in range(m):
                        spread = (x[t, j, seen[a]] - mean[t, a]) * (x[t, j, seen[b]] - mean[t, b])
                        S[t, a, b] += weight * (P[t, j, seen[a], seen[b]] + spread)
        for a in range(m):
            for b in range(m):
                S[t, a, b] += R[a, b]
    return mean, S
