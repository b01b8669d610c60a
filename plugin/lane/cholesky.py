"""Kernels of positive definite equations of any size by Cholesky's method."""

import math

from sumo_net.compile import kernel


@kernel
def cholesky(A, L, least):  # type: ignore[no-untyped-def]
    """L with L Lᵀ = A (lower triangle read), which may be A itself; False where A is not positive definite.

    Nor is it where a pivot is at most the share `least` of its diagonal element.
    """
    n = A.shape[0]
    for j in range(n):
        s, floor = A[j, j], least * abs(A[j, j])
        for k in range(j):
            s -= L[j, k] * L[j, k]
        if not s > floor:  # also where NaN
            return False
        L[j, j] = math.sqrt(s)
        inverse = 1.0 / L[j, j]
        for i in range(j + 1, n):
            s = A[i, j]
            for k in range(j):
                s -= L[i, k] * L[j, k]
            L[i, j] = s * inverse
    return True


@kernel
def solve(L, b):  # type: ignore[no-untyped-def]
    """b <- (L Lᵀ)⁻¹ b."""
    n = L.shape[0]
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= L[i, k] * b[k]
        b[i] = s / L[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= L[k, i] * b[k]
        b[i] = s / L[i, i]


@kernel
def invert(A, L, out):  # type: ignore[no-untyped-def]
    """out <- A⁻¹; L is work space. False where the symmetric A is not positive definite."""
    n = A.shape[0]
    if not cholesky(A, L, 0.0):
        return False
    # L⁻¹ by rows into out's lower triangle, then L⁻ᵀ L⁻¹
    for j in range(n):
        out[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, n):
            s = 0.0
            for k in range(j, i):
                s -= L[i, k] * out[k, j]
            out[i, j] = s / L[i, i]
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(i, n):
                s += out[k, i] * out[k, j]
            L[i, j] = s
    for i in range(n):
        for j in range(i + 1):
            out[i, j] = L[i, j]
            out[j, i] = L[i, j]
    return True
