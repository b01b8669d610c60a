"""Kernels of the adaptive (Sage–Husa) Kalman filter, in the safe residual form and as published."""

import math

import numpy as np

from plugin.tracking.kalman_kernels import MEASURED, STATES, cholesky, gain
from sumo_net.compile import inlined, kernel

R_INDEFINITE, Q_INDEFINITE, P_INDEFINITE, S_INDEFINITE, NOT_FINITE = 1, 2, 4, 8, 16
RUNAWAY = 1e8  # larger numbers mean that the recursion diverges


@kernel
def forgetting(b, k):  # type: ignore[no-untyped-def]
    """d_k = (1 − b) / (1 − b^{k+1}), below eq. (10)."""
    return (1.0 - b) / (1.0 - b ** (k + 1.0))


@inlined
def innovation_covariance(P, H, R, PHt, S):  # type: ignore[no-untyped-def]
    """PHt = P Hᵀ (n, m) and S = H P Hᵀ + R (m, m)."""
    m, n = MEASURED, STATES
    for j in range(m):
        for i in range(n):
            PHt[i, j] = 0.0
        for k in range(n):
            h = H[j, k]
            if h != 0.0:
                for i in range(n):
                    PHt[i, j] += P[i, k] * h
    for i in range(m):
        for j in range(m):
            S[i, j] = R[i, j]
        for k in range(n):
            h = H[i, k]
            if h != 0.0:
                for j in range(m):
                    S[i, j] += h * PHt[k, j]


@inlined
def _joseph(P, K, H, R, A, work):  # type: ignore[no-untyped-def]
    """P = (I − K H) P (I − K H)ᵀ + K R Kᵀ in place for any gain K (n, m); A, work (n, n) are scratch.

    Computed as M + (K R − M Hᵀ) Kᵀ with M = P − K (H P), the same without a product of two (n, n) matrices.
    """
    n, m = STATES, MEASURED
    for k in range(m):  # A: the rows of H P, then those of Kᵀ
        for j in range(n):
            A[k, j] = 0.0
            A[m + k, j] = K[j, k]
        for i in range(n):
            h = H[k, i]
            if h != 0.0:
                for j in range(n):
                    A[k, j] += h * P[i, j]
    for i in range(n):
        for j in range(n):
            work[i, j] = P[i, j]
        for k in range(m):
            gain = K[i, k]
            for j in range(n):
                work[i, j] -= gain * A[k, j]
    for i in range(n):
        for j in range(n):
            P[i, j] = work[i, j]
        for k in range(m):
            weight = 0.0
            for a in range(m):
                weight += K[i, a] * R[a, k]
            for a in range(n):
                if H[k, a] != 0.0:
                    weight -= work[i, a] * H[k, a]
            for j in range(n):
                P[i, j] += weight * A[m + k, j]
        for j in range(i):
            P[j, i] = P[i, j]


@inlined
def _update_one(x, P, y, H, R, K, S, L, A, work):  # type: ignore[no-untyped-def]
    """Update x (n,) and P (n, n) in place with the innovation y (m,) of any H; give its log-likelihood.

    K (n, m) and S (m, m) are left filled with the gain and the innovation's covariance; L (m, m), A and work
    (n, n) are scratch. Where S is not positive definite nothing is changed and the likelihood is NaN.
    """
    innovation_covariance(P, H, R, K, S)
    log_likelihood = gain(S, L, y, K)
    if not math.isnan(log_likelihood):
        for i in range(STATES):
            for j in range(MEASURED):
                x[i] += K[i, j] * y[j]
        _joseph(P, K, H, R, A, work)
    return log_likelihood


@kernel
def update_safe(x, P, R, k, z, seen, H, which, b):  # type: ignore[no-untyped-def]
    """Joseph-form update with R, then R ← (1 − d) R + d (ε εᵀ + H P⁺ Hᵀ), ε = z − H x⁺.

    Both terms are non-negative, so R stays positive definite whatever is measured. x (T, n), P (T, n, n),
    R (T, m, m), k (T,) updates so far, z (T, m), seen (T,), H (U, m, n), which (T,) into U. Gives x, P, R, k.
    """
    tracks, n, m = len(x), STATES, MEASURED
    x, P, R, k = x.copy(), P.copy(), R.copy(), k.copy()
    y, K, S, L = np.empty(m), np.empty((n, m)), np.empty((m, m)), np.empty((m, m))
    A, work = np.empty((n, n)), np.empty((n, n))
    for t in range(tracks):
        if not seen[t]:
            continue
        h = H[which[t]]
        _innovation(x[t], z[t], h, y)
        if math.isnan(_update_one(x[t], P[t], y, h, R[t], K, S, L, A, work)):
            continue
        d = forgetting(b, k[t])
        _innovation(x[t], z[t], h, y)
        for i in range(m):
            for j in range(m):
                R[t, i, j] *= (1.0 - d) / d
        innovation_covariance(P[t], h, R[t], K, S)  # (1 − d)/d R + H P⁺ Hᵀ
        for i in range(m):
            for j in range(i, m):
                R[t, i, j] = d * (0.5 * (S[i, j] + S[j, i]) + y[i] * y[j])
                R[t, j, i] = R[t, i, j]
        k[t] += 1.0
    return x, P, R, k


@kernel
def update_patent(x, P, q, Q, r, R, k, z, seen, H, which, b, adapt_process):  # type: ignore[no-untyped-def]
    """Eqs. (10) to (14) as published; indefinite and non-finite matrices are marked in `flags` (T,) int64.

    x, P come from eqs. (8) and (9). q (T, n), Q (T, n, n), r (T, m), R (T, m, m) are the recursive estimates;
    with `adapt_process` false q, Q and r stay. Eq. (14) prints the brackets of r̂ wrongly: (1 − d) r̂ + d (…)
    is meant. Gives x, P, q, Q, r, R, k, flags.
    """
    tracks, n, m = len(x), STATES, MEASURED
    x, P, q, Q, r, R, k = x.copy(), P.copy(), q.copy(), Q.copy(), r.copy(), R.copy(), k.copy()
    flags = np.zeros(tracks, np.int64)
    raw, e, L, L_n = np.empty(m), np.empty(m), np.empty((m, m)), np.empty((n, n))
    K, PHt, S, HPH = np.empty((n, m)), np.empty((n, m)), np.empty((m, m)), np.empty((m, m))
    zero, Pp, Ke = np.zeros((m, m)), np.empty((n, n)), np.empty(n)
    for t in range(tracks):
        if not seen[t]:
            continue
        h = H[which[t]]
        d = forgetting(b, k[t])
        _innovation(x[t], z[t], h, raw)
        for i in range(m):
            e[i] = raw[i] - r[t, i]  # (10)
        innovation_covariance(P[t], h, zero, PHt, HPH)
        for i in range(m):
            for j in range(m):
                S[i, j] = HPH[i, j] + R[t, i, j]
        if not _definite(S, L):
            flags[t] |= S_INDEFINITE
        if not _regular_gain(S, PHt, K):  # (11)
            flags[t] |= NOT_FINITE
            continue
        for i in range(n):
            Ke[i] = 0.0
            for j in range(m):
                Ke[i] += K[i, j] * e[j]
        for i in range(n):  # (13), not symmetrised
            for j in range(n):
                total = P[t, i, j]
                for a in range(m):
                    total -= K[i, a] * PHt[j, a]
                Pp[i, j] = total
        if adapt_process:
            for i in range(n):
                # (14): x⁺ − A x = K ε + q̂, and A P Aᵀ = P(k+1|k) − Q̂ by (9)
                q[t, i] = (1.0 - d) * q[t, i] + d * (Ke[i] + q[t, i])
                for j in range(n):
                    growth = Pp[i, j] - (P[t, i, j] - Q[t, i, j])
                    Q[t, i, j] = (1.0 - d) * Q[t, i, j] + d * (Ke[i] * Ke[j] + growth)
            for i in range(m):
                r[t, i] = (1.0 - d) * r[t, i] + d * raw[i]
        for i in range(m):
            for j in range(m):
                R[t, i, j] = (1.0 - d) * R[t, i, j] + d * (e[i] * e[j] - HPH[i, j])
        finite = True
        for i in range(n):
            x[t, i] += Ke[i]  # (12)
            finite &= abs(x[t, i]) < RUNAWAY and abs(Pp[i, i]) < RUNAWAY  # False for NaN
            for j in range(n):
                P[t, i, j] = Pp[i, j]
        k[t] += 1.0
        if not finite:
            flags[t] |= NOT_FINITE
        if not _definite(R[t], L):
            flags[t] |= R_INDEFINITE
        if not _definite(P[t], L_n):
            flags[t] |= P_INDEFINITE
        if not _definite(Q[t], L_n):
            flags[t] |= Q_INDEFINITE
    return x, P, q, Q, r, R, k, flags


@kernel
def measurement_covariance(P, R, H, which):  # type: ignore[no-untyped-def]
    """S (T, m, m) = H P Hᵀ + R for each track, and whether it is positive definite (T,)."""
    tracks, n, m = len(P), STATES, MEASURED
    S, definite = np.empty((tracks, m, m)), np.empty(tracks, np.bool_)
    PHt, L = np.empty((n, m)), np.empty((m, m))
    for t in range(tracks):
        innovation_covariance(P[t], H[which[t]], R[t], PHt, S[t])
        for i in range(m):
            for j in range(i):
                S[t, i, j] = S[t, j, i] = 0.5 * (S[t, i, j] + S[t, j, i])
        definite[t] = cholesky(S[t], L)
    return S, definite


@kernel
def _innovation(x, z, h, y):  # type: ignore[no-untyped-def]
    for i in range(MEASURED):
        y[i] = z[i]
        for a in range(STATES):
            y[i] -= h[i, a] * x[a]


@kernel
def _definite(M, L):  # type: ignore[no-untyped-def]
    """Whether the symmetric part of M is non-negative up to rounding; M may be singular."""
    n = M.shape[0]
    lift = 0.0
    for i in range(n):
        lift += 1e-12 * abs(M[i, i])
    for i in range(n):
        for j in range(i + 1):
            total = 0.5 * (M[i, j] + M[j, i])
            if i == j:
                total += lift + 1e-300
            for a in range(j):
                total -= L[i, a] * L[j, a]
            if i == j:
                if not total > 0.0:
                    return False
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    return True


@kernel
def _regular_gain(S, PHt, K):  # type: ignore[no-untyped-def]
    """K = P Hᵀ S⁻¹ for any regular S, also an indefinite one; False where S is singular or not finite."""
    inverse = np.empty_like(S)
    m = MEASURED
    work = S.copy()
    for i in range(m):
        for j in range(m):
            inverse[i, j] = 1.0 if i == j else 0.0
    for column in range(m):  # Gauss–Jordan with row pivots
        pivot = column
        for i in range(column + 1, m):
            if abs(work[i, column]) > abs(work[pivot, column]):
                pivot = i
        scale = work[pivot, column]
        if scale == 0.0 or not math.isfinite(scale):
            return False
        for j in range(m):
            work[column, j], work[pivot, j] = work[pivot, j], work[column, j]
            inverse[column, j], inverse[pivot, j] = inverse[pivot, j], inverse[column, j]
        for j in range(m):
            work[column, j] /= scale
            inverse[column, j] /= scale
        for i in range(m):
            factor = work[i, column]
            if i != column and factor != 0.0:
                for j in range(m):
                    work[i, j] -= factor * work[column, j]
                    inverse[i, j] -= factor * inverse[column, j]
    for i in range(STATES):
        for j in range(m):
            K[i, j] = 0.0
            for a in range(m):
                K[i, j] += PHt[i, a] * inverse[a, j]
    return True
