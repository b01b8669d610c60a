"""Kernels of the Kalman filter: small dense algebra, and predict and update over all tracks at once.

The matrices of tracking are small and half empty (block-diagonal F, selecting H), so the products skip zeros.
All tracking models here have six states and three measured components (n, m in the shapes below); as
constants they let the compiler unroll loops, which halves the time. Functions on one track are therefore
inlined into the kernels over all tracks, which copy a track into arrays of constant size.

The states MEASURES themselves are measured: H selects them and is never multiplied by.

Every batch takes T tracks along the first axis; which transition a track takes is an index into U of them,
since most tracks of a fleet share one time step.
"""

import math

import numpy as np

from sumo_net.compile import inlined, kernel
from sumo_net.frames import wrap_angle
from sumo_net.scratch import scratch

STATES, MEASURED = 6, 3
MEASURES = (0, 1, 3)  # the states that are measured: (r, ṙ, β), or (x, ẋ, y) over ground
LOG_TWO_PI = math.log(2.0 * math.pi)


@inlined
def copy(M, out):  # type: ignore[no-untyped-def]
    """out = M, two matrices."""
    for i in range(M.shape[0]):
        for j in range(M.shape[1]):
            out[i, j] = M[i, j]


@inlined
def clear(out):  # type: ignore[no-untyped-def]
    """out = 0, a matrix."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0


@inlined
def congruence(A, P, out):  # type: ignore[no-untyped-def]
    """out = A P Aᵀ for a symmetric P (n, n), exactly symmetric. out may be P.

    Both products run along rows, which are contiguous in memory; for this the first is kept transposed.
    """
    turned, row = scratch((STATES, STATES)), scratch(STATES)
    for i in range(STATES):
        combined(A[i], P, row)
        for j in range(STATES):
            turned[j, i] = row[j]
    for i in range(STATES):
        combined(A[i], turned, row)
        for j in range(i + 1):
            out[i, j] = row[j]
            out[j, i] = row[j]


@inlined
def combined(a, M, row):  # type: ignore[no-untyped-def]
    """row = a M, a (n,), M (n, n)."""
    for j in range(STATES):
        row[j] = 0.0
    for k in range(STATES):
        if a[k] != 0.0:
            for j in range(STATES):
                row[j] += a[k] * M[k, j]


@inlined
def cholesky(S, L):  # type: ignore[no-untyped-def]
    """Lower L of S = L Lᵀ into `L`; False where S is not positive definite: L then holds NaN or 1/0."""
    definite = True
    for i in range(MEASURED):
        for j in range(i + 1):
            total = S[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                definite &= total > 0.0  # False for NaN, too
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    return definite


@inlined
def solve_cholesky(L, K):  # type: ignore[no-untyped-def]
    """Solve L Lᵀ y = b in place of each row b of K (n, m); the diagonal of L holds its reciprocals."""
    m = MEASURED
    for row in range(STATES):
        for i in range(m):
            total = K[row, i]
            for k in range(i):
                total -= L[i, k] * K[row, k]
            K[row, i] = total * L[i, i]
        for i in range(m - 1, -1, -1):
            total = K[row, i]
            for k in range(i + 1, m):
                total -= L[k, i] * K[row, k]
            K[row, i] = total * L[i, i]


@inlined
def predict_one(x, P, F, Q, shift, xp, Pp):  # type: ignore[no-untyped-def]
    """xp = F x + shift, Pp = F P Fᵀ + Q. xp, Pp may not be x, P."""
    n = STATES
    for i in range(n):
        total = shift[i]
        for k in range(n):
            total += F[i, k] * x[k]
        xp[i] = total
    congruence(F, P, Pp)
    for i in range(n):
        for j in range(n):
            Pp[i, j] += Q[i, j]


@inlined
def mahalanobis(L, y, w):  # type: ignore[no-untyped-def]
    """yᵀ S⁻¹ y with S = L Lᵀ; w (m,) is scratch."""
    total = 0.0
    for i in range(MEASURED):
        rest = y[i]
        for k in range(i):
            rest -= L[i, k] * w[k]
        w[i] = rest / L[i, i]
        total += w[i] * w[i]
    return total


@inlined
def gain(S, L, y, K):  # type: ignore[no-untyped-def]
    """K = P Hᵀ S⁻¹ in place of P Hᵀ (n, m), and the log-likelihood of the innovation y (m,); L is scratch.

    NaN where S (m, m) is not positive definite; K is then as it was.
    """
    if not cholesky(S, L):
        return math.nan
    w = scratch(MEASURED)
    log_likelihood = -0.5 * (MEASURED * LOG_TWO_PI + mahalanobis(L, y, w))
    determinant = 1.0
    for j in range(MEASURED):
        determinant *= L[j, j]
        L[j, j] = 1.0 / L[j, j]
    log_likelihood -= math.log(determinant)
    solve_cholesky(L, K)  # S being symmetric
    return log_likelihood


@inlined
def joseph(P, K, R):  # type: ignore[no-untyped-def]
    """P = (I − K H) P (I − K H)ᵀ + K R Kᵀ in place for any gain K (n, m), H selecting MEASURES.

    Computed as M + (K R − M Hᵀ) Kᵀ with M = P − K (H P), the same without a product of two (n, n) matrices.
    """
    M, weight = scratch((STATES, STATES)), scratch(MEASURED)
    for i in range(STATES):
        for j in range(STATES):
            M[i, j] = P[i, j]
            for k in range(MEASURED):
                M[i, j] -= K[i, k] * P[MEASURES[k], j]
    for i in range(STATES):
        for k in range(MEASURED):
            weight[k] = 0.0
            for a in range(MEASURED):
                weight[k] += K[i, a] * R[a, k]
            weight[k] -= M[i, MEASURES[k]]
        for j in range(i + 1):
            P[i, j] = M[i, j]
            for k in range(MEASURED):
                P[i, j] += weight[k] * K[j, k]
            P[j, i] = P[i, j]


@inlined
def innovation(x, z, angle, y):  # type: ignore[no-untyped-def]
    """y = z − H x (m,), angles (m,) wrapped."""
    for i in range(MEASURED):
        y[i] = z[i] - x[MEASURES[i]]
        if angle[i]:
            y[i] = wrap_angle(y[i])


@inlined
def innovation_covariance(P, R, PHt, S):  # type: ignore[no-untyped-def]
    """P Hᵀ (n, m) and S = H P Hᵀ + R (m, m) into `PHt` and `S`."""
    for j in range(MEASURED):
        for i in range(STATES):
            PHt[i, j] = P[i, MEASURES[j]]
        for i in range(MEASURED):
            S[i, j] = R[i, j] + P[MEASURES[i], MEASURES[j]]


@inlined
def update_one(x, P, y, R, S):  # type: ignore[no-untyped-def]
    """Update x (n,) and P (n, n) in place with the innovation y (m,); give its log-likelihood.

    S (m, m) is left filled with the innovation's covariance. Where it is not positive definite nothing is
    changed and the likelihood is NaN.
    """
    K, L = scratch((STATES, MEASURED)), scratch((MEASURED, MEASURED))
    innovation_covariance(P, R, K, S)
    log_likelihood = gain(S, L, y, K)
    if not math.isnan(log_likelihood):
        for i in range(STATES):
            for j in range(MEASURED):
                x[i] += K[i, j] * y[j]
        joseph(P, K, R)
    return log_likelihood


@kernel
def predict(x, P, F, Q, which, shift):  # type: ignore[no-untyped-def]
    """x⁺ = F x + shift, P⁺ = F P Fᵀ + Q for x (T, n), P (T, n, n), F and Q (U, n, n), which (T,) into U."""
    xp, Pp = np.empty_like(x), np.empty_like(P)
    for t in range(len(x)):
        u = which[t]
        predict_one(x[t], P[t], F[u], Q[u], shift[t], xp[t], Pp[t])
    return xp, Pp


@kernel
def update(x, P, z, seen, R, angle):  # type: ignore[no-untyped-def]
    """Joseph-form update of x (T, n), P (T, n, n) with z (T, m) where `seen`; R (m, m).

    `angle` (m,) says which components of z are angles, so that their innovation is wrapped. Gives x, P, the
    innovation y (T, m), its covariance S (T, m, m) and log-likelihood (T,), the last three NaN without a
    measurement; where S was not positive definite the likelihood alone is NaN, and x and P are unchanged.
    """
    tracks, m = len(x), MEASURED
    x, P = x.copy(), P.copy()
    y, S = np.full((tracks, m), np.nan), np.full((tracks, m, m), np.nan)
    log_likelihood = np.full(tracks, np.nan)
    one_R, one_S, one_P = scratch((m, m)), scratch((m, m)), scratch((STATES, STATES))
    copy(R, one_R)
    for t in range(tracks):
        if seen[t]:
            innovation(x[t], z[t], angle, y[t])
            copy(P[t], one_P)
            log_likelihood[t] = update_one(x[t], one_P, y[t], one_R, one_S)
            copy(one_P, P[t])
            copy(one_S, S[t])
    return x, P, y, S, log_likelihood
