"""Kernels of the Kalman update of many tracks at once.

The matrices of one track are too small for vector instructions on eight numbers. Within a block the numbers
of neighbouring tracks lie side by side and nothing branches, so that each instruction handles eight tracks.
"""

import math
from typing import Any, NamedTuple

from plugin.tracking.kalman_kernels import (
    MEASURED,
    STATES,
    cholesky,
    innovation_covariance,
    joseph,
    mahalanobis,
    solve_cholesky,
)
from sumo_net.compile import inlined
from sumo_net.scratch import scratch

BLOCK = 64


class Block(NamedTuple):
    """Up to BLOCK tracks, along the last axis."""

    x: Any  # (n, BLOCK)
    P: Any  # (n, n, BLOCK), of which the lower triangle is used
    y: Any  # (m, BLOCK) innovations
    squared: Any  # (BLOCK,) yᵀ S⁻¹ y of the last update
    determinant: Any  # (BLOCK,) of the Cholesky factor of S; NaN where S was not positive definite


@inlined
def put(block, place, x, P, y):  # type: ignore[no-untyped-def]
    """Copy a track's x (n,), P (n, n) and innovation y (m,) to its place in the block."""
    for i in range(STATES):
        block.x[i, place] = x[i]
        for j in range(i + 1):
            block.P[i, j, place] = P[i, j]
    for i in range(MEASURED):
        block.y[i, place] = y[i]


@inlined
def take(block, place, x, P):  # type: ignore[no-untyped-def]
    """Copy the state at `place` of the block to x (n,) and P (n, n)."""
    for i in range(STATES):
        x[i] = block.x[i, place]
        for j in range(i + 1):
            P[i, j] = block.P[i, j, place]
            P[j, i] = P[i, j]


@inlined
def update(block, used, R):  # type: ignore[no-untyped-def]
    """Joseph-form update of the first `used` tracks; one whose S is not positive definite is lost."""
    for place in range(used):
        _update_one(block, place, R)


@inlined
def _update_one(block, place, R):  # type: ignore[no-untyped-def]
    x, P, y = scratch(STATES), scratch((STATES, STATES)), scratch(MEASURED)
    K, S, L = scratch((STATES, MEASURED)), scratch((MEASURED, MEASURED)), scratch((MEASURED, MEASURED))
    take(block, place, x, P)
    for i in range(MEASURED):
        y[i] = block.y[i, place]
    innovation_covariance(P, R, K, S)
    definite = cholesky(S, L)
    block.squared[place] = mahalanobis(L, y, scratch(MEASURED))
    determinant = 1.0
    for j in range(MEASURED):
        determinant *= L[j, j]
        L[j, j] = 1.0 / L[j, j]
    block.determinant[place] = determinant if definite else math.nan
    solve_cholesky(L, K)
    for i in range(STATES):
        for j in range(MEASURED):
            x[i] += K[i, j] * y[j]
    joseph(P, K, R)
    put(block, place, x, P, y)
