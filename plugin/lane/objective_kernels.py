"""Kernels of the published objective function (Zhang et al. 2011, eqs. 2, 3).

A block's contribution, α·mean + Σ βⱼTⱼ, is linear in its nine grey values. So one 3×3 stencil per border and
slope class turns the frame into a map of block values, and a candidate parabola costs fifty look-ups.
With the published weights the stencils times 90 are whole numbers: the maps are exact.
"""

import math

import numpy as np

from sumo_net.compile import kernel

BLOCKS = 50  # along a border, at most
BLOCK_PX = 3  # block size and spacing: centres at y = 1, 4, ..., 148
FIRST_COLUMN, LAST_COLUMN = 1, 318  # of a block's centre, 0-based; 2 and 319 in the source's 1-based count
UNIT = 90  # map values are in 1/90 grey level
NO_SCORE = -1000.0  # of a candidate without any block; lower than any objective


@kernel
def road_grey(frame, left, right, rows):  # type: ignore[no-untyped-def]
    """Mean grey of the road surface: columns [left, right) of the bottom `rows` rows, every third row."""
    height = frame.shape[0]
    total = count = np.int64(0)
    for row in range(height - 1, height - 1 - rows, -BLOCK_PX):
        for column in range(left, right):
            total += np.int64(frame[row, column])
        count += right - left
    return total / count


@kernel
def slope_class(slope):  # type: ignore[no-untyped-def]
    """Row of tables 1 and 2: 0 for 0.5 ≤ slope ≤ 2, 1 for slope > 2, 2 for slope < 0.5.

    `slope` is b on the left border and -b on the right one, as in eqs. 2 and 3.
    """
    if slope > 2.0:
        return 1
    if slope < 0.5:
        return 2
    return 0


@kernel
def reachable_columns(low, high, blocks, first, last):  # type: ignore[no-untyped-def]
    """Columns [first[i], last[i]] where any parabola with low ≤ (a, b, c) ≤ high has its i-th block.

    x grows with each of a, b and c, since y ≥ 0: so two corners of the region bound it.
    """
    for i in range(blocks):
        y = 1.0 + BLOCK_PX * i
        lowest = math.floor((low[0] * y + low[1]) * y + low[2] + 0.5) - 1.0  # -1, +1: rounding of the decoder
        highest = math.floor((high[0] * y + high[1]) * y + high[2] + 0.5) + 1.0
        first[i] = np.int64(min(max(lowest, FIRST_COLUMN), LAST_COLUMN + 1.0))  # empty where first > last
        last[i] = np.int64(max(min(highest, LAST_COLUMN), FIRST_COLUMN - 1.0))


@kernel
def block_map(frame, stencil, blocks, first, last, values):  # type: ignore[no-untyped-def]
    """Fill values[i, first[i]:last[i] + 1] with the stencil's response at the blocks of row y = 1 + 3i.

    frame (240, 320) uint8, stencil (3, 3) int32 with the upper row first, values (50, 320) int32.
    """
    # scalars, and slices indexed from 0, so that the loop is vectorised
    s00, s01, s02 = stencil[0, 0], stencil[0, 1], stencil[0, 2]
    s10, s11, s12 = stencil[1, 0], stencil[1, 1], stencil[1, 2]
    s20, s21, s22 = stencil[2, 0], stencil[2, 1], stencil[2, 2]
    for i in range(blocks):
        start, stop = first[i] - 1, last[i] + 2
        middle = frame.shape[0] - 2 - BLOCK_PX * i
        up, mid, low = frame[middle - 1, start:stop], frame[middle, start:stop], frame[middle + 1, start:stop]
        row = values[i, start + 1 : stop - 1]
        for x in range(stop - start - 2):
            row[x] = (
                s00 * np.int32(up[x])
                + s01 * np.int32(up[x + 1])
                + s02 * np.int32(up[x + 2])
                + s10 * np.int32(mid[x])
                + s11 * np.int32(mid[x + 1])
                + s12 * np.int32(mid[x + 2])
                + s20 * np.int32(low[x])
                + s21 * np.int32(low[x + 1])
                + s22 * np.int32(low[x + 2])
            )


@kernel
def mean_value(values, a, b, c, road, blocks, minimum_blocks):  # type: ignore[no-untyped-def]
    """F of eqs. 2 and 3 for x = a·y² + b·y + c: the mean over its blocks of map value minus `road` (α·grey).

    With n < m = minimum_blocks blocks it is min(Σ/n, Σ/m): few blocks cannot win. NO_SCORE without a block.
    Columns of `values` outside FIRST_COLUMN to LAST_COLUMN must be 0: they stand for blocks outside.
    """
    c += 0.5
    beside = values.shape[1] - 1.0
    total = count = np.int64(0)
    for i in range(blocks):
        y = 1.0 + BLOCK_PX * i
        x = np.uint32(min(max((a * y + b) * y + c, 0.0), beside))
        total += values[i, x]
        count += (x >= FIRST_COLUMN) & (x <= LAST_COLUMN)
    if count == 0:
        return NO_SCORE
    over_road = total / UNIT - count * road
    mean = over_road / count
    if count < minimum_blocks:
        mean = min(mean, over_road / minimum_blocks)
    return mean


@kernel
def objective_kernel(frames, left, right, stencils, alpha, region, blocks, minimum_blocks, score):  # type: ignore[no-untyped-def]
    """score[v] = (F of the left, F of the right border) in frames[v], for the whole fleet."""
    values = np.zeros((BLOCKS, frames.shape[2]), np.int32)
    first = np.empty(BLOCKS, np.int64)
    last = np.empty(BLOCKS, np.int64)
    for v in range(frames.shape[0]):
        grey = road_grey(frames[v], region[0], region[1], region[2])
        for side in range(2):
            border = (left if side == 0 else right)[v]
            row = slope_class(border[1] if side == 0 else -border[1])
            reachable_columns(border, border, blocks, first, last)
            block_map(frames[v], stencils[side, row], blocks, first, last, values)
            score[v, side] = mean_value(
                values, border[0], border[1], border[2], alpha[row] * grey, blocks, minimum_blocks
            )
