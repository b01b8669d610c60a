"""Kernels of the Kalman filter: small dense algebra, and predict and update over all tracks at once.

The matrices of tracking are small and half empty (block-diagonal F, selecting H), so the products skip zeros.
All models of tracking here have six states and three measured components; as constants they let the compiler
unroll, which halves the time. (n, m in the shapes below.) For that, what works on one track is put whole into
the kernels over all tracks, which copy a track into arrays of constant size.

Every batch takes T tracks along the first axis; which transition a track takes is an index into U of them,
since most tracks of a fleet share one time step.
"""

import math

import numpy as np

from sumo_net.compile import inlined, kernel
from sumo_net.frames import wrap_angle

STATES, MEASURED = 6, 3
LOG_TWO_PI = math.log(2.0 * math.pi)


@inlined
def congruence(A, P, work, out):  # type: ignore[no-untyped-def]
    """out = A P Aᵀ for a symmetric P (n, n), exactly symmetric; `work` (n, n) is scratch. out may be P."""
    n = STATES
    for i in range(n):
        for j in range(n):
            work[i, j] = 0.0
        for k in range(n):
            a = A[i, k]
            if a != 0.0:
                for j in range(n):
                    work[i, j] += a * P[k, j]
    for j in range(n):
        for i in range(j + 1):
            out[i, j] = 0.0
        for k in range(n):
            a = A[j, k]
            if a != 0.0:
                for i in range(j + 1):
                    out[i, j] += work[i, k] * a
        for i in range(j):
            out[j, i] = out[i, j]


@inlined
def cholesky(S, L):  # type: ignore[no-untyped-def]
    """Lower L of S = L Lᵀ into `L`; False where S is not positive definite (L is then unfinished)."""
    n = MEASURED
    for i in range(n):
        for j in range(i + 1):
            total = S[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > 0.0:  # also catches NaN
                    return False
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    return True


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
def predict_one(x, P, F, Q, shift, xp, Pp, work):  # type: ignore[no-untyped-def]
    """xp = F x + shift, Pp = F P Fᵀ + Q. xp, Pp may not be x, P."""
    n = STATES
    for i in range(n):
        total = shift[i]
        for k in range(n):
            total += F[i, k] * x[k]
        xp[i] = total
    congruence(F, P, work, Pp)
    for i in range(n):
        for j in range(n):
            Pp[i, j] += Q[i, j]


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
def joseph(P, K, H, R, A, work):  # type: ignore[no-untyped-def]
    """P = (I − K H) P (I − K H)ᵀ + K R Kᵀ in place for any gain K (n, m); A, work (n, n) are scratch.

    As M + (K R − M Hᵀ) Kᵀ with M = P − K (H P), which is the same and needs no product of two (n, n).
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
def update_one(x, P, y, H, R, K, S, L, A, work):  # type: ignore[no-untyped-def]
    """Update x (n,) and P (n, n) in place with the innovation y (m,), m ≤ n; give its log-likelihood.

    K (n, m) and S (m, m) are left filled with the gain and the innovation's covariance; L (m, m), A and work
    (n, n) are scratch. Where S is not positive definite nothing is changed and the likelihood is NaN.
    """
    n, m = STATES, MEASURED
    innovation_covariance(P, H, R, K, S)
    if not cholesky(S, L):
        return math.nan
    log_likelihood = -0.5 * (m * LOG_TWO_PI + mahalanobis(L, y, work[0]))
    determinant = 1.0
    for j in range(m):
        determinant *= L[j, j]
        L[j, j] = 1.0 / L[j, j]
    log_likelihood -= math.log(determinant)
    solve_cholesky(L, K)  # K = P Hᵀ S⁻¹, S being symmetric
    for i in range(n):
        for j in range(m):
            x[i] += K[i, j] * y[j]
    joseph(P, K, H, R, A, work)
    return log_likelihood


@kernel
def predict(x, P, F, Q, which, shift):  # type: ignore[no-untyped-def]
    """x⁺ = F x + shift, P⁺ = F P Fᵀ + Q for x (T, n), P (T, n, n), F and Q (U, n, n), which (T,) into U."""
    tracks, n = len(x), STATES
    xp, Pp, work = np.empty_like(x), np.empty_like(P), np.empty((n, n))
    for t in range(tracks):
        u = which[t]
        predict_one(x[t], P[t], F[u], Q[u], shift[t], xp[t], Pp[t], work)
    return xp, Pp


@kernel
def update(x, P, z, seen, H, R, angle):  # type: ignore[no-untyped-def]
    """Joseph-form update of x (T, n), P (T, n, n) with z (T, m) where `seen`; H (m, n), R (m, m).

    `angle` (m,) says which components of z are angles, so that their innovation is wrapped. Gives x, P, the
    innovation y (T, m), its covariance S (T, m, m) and log-likelihood (T,), the last three NaN where nothing
    was seen; the likelihood alone is NaN where S was not positive definite, and x and P are then unchanged.
    """
    tracks, n = len(x), STATES
    m = MEASURED
    x, P = x.copy(), P.copy()
    y, S = np.full((tracks, m), np.nan), np.full((tracks, m, m), np.nan)
    log_likelihood = np.full(tracks, np.nan)
    K, L, A, work = np.empty((n, m)), np.empty((m, m)), np.empty((n, n)), np.empty((n, n))
    for t in range(tracks):
        if not seen[t]:
            continue
        for j in range(m):
            total = z[t, j]
            for k in range(n):
                total -= H[j, k] * x[t, k]
            y[t, j] = wrap_angle(total) if angle[j] else total
        log_likelihood[t] = update_one(x[t], P[t], y[t], H, R, K, S[t], L, A, work)
    return x, P, y, S, log_likelihood
