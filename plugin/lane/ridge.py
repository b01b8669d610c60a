"""Marking candidates on an image row: bright ridges of the width that paint has at that distance.

A ridge is brighter than the road on *both* sides, so the single edge of a shadow, a kerb or a car gives no
response.
"""

import math

import numpy as np

from sumo_net.compile import kernel

BUFFER_PX = 320


@kernel
def road_noise(frame, row, first, last):  # type: ignore[no-untyped-def]
    """Mean absolute difference of neighbouring pixels on part of an array row, in grey levels."""
    lo, hi = max(0, int(first)), min(frame.shape[1] - 1, int(last))
    if hi - lo < 4:
        return math.nan
    line, total = frame[row, lo : hi + 1], np.int32(0)
    for j in range(hi - lo):
        total += abs(np.int32(line[j + 1]) - np.int32(line[j]))
    return total / (hi - lo)


@kernel
def candidates(frame, row, stack, lean, column, half, width_px, noise, t, sums, response, out):  # type: ignore[no-untyped-def]
    """The strongest ridges with their centre within `half` pixels of `column`; out (M, 2): centre, strength.

    The response is the mean grey over the paint's width minus the mean of the brighter flank; the strength is
    the response over the level that texture and noise reach, at least 1. The centre is the centroid of the
    grey above the flanks. frame (240, 320) uint8; row: array row; stack: 1, or 3 to average the row with its
    neighbours along a line that goes `lean` columns to the right per row upwards; noise: standard deviation
    of a pixel. sums, response: work space. Returns the number of ridges.
    """
    columns = frame.shape[1]
    box = max(1, int(width_px + 0.5))
    flank = max(2, min(box, 6))
    reach = flank + 1  # one pixel on each side is left out: it is partly paint
    shift = math.floor(lean + 0.5) if stack == 3 else 0
    margin = reach + abs(shift)
    lowest = max(math.ceil(column - half - 0.5 * (box - 1)), margin)
    highest = min(math.floor(column + half - 0.5 * (box - 1)), columns - box - margin)
    count = highest - lowest + 1
    if count < 1:
        return 0
    base = lowest - reach
    length = count + box + 2 * reach - 1
    total = np.int32(0)
    sums[0] = total
    line = frame[row, base : base + length]
    if stack == 3:
        upper = frame[row - 1, base + shift : base + shift + length]
        lower = frame[row + 1, base - shift : base - shift + length]
        for j in range(length):
            total += np.int32(line[j]) + np.int32(upper[j]) + np.int32(lower[j])
            sums[j + 1] = total
    else:
        for j in range(length):
            total += np.int32(line[j])
            sums[j + 1] = total
    threshold = max(t.contrast, t.noise_factor * noise * math.sqrt((1.0 / box + 1.0 / flank) / stack))
    per_box, per_flank = 1.0 / (box * stack), 1.0 / (flank * stack)
    for k in range(count):
        inner = sums[k + reach + box] - sums[k + reach]
        one = sums[k + flank] - sums[k]
        other = sums[k + box + 2 * reach] - sums[k + box + reach + 1]
        response[k] = inner * per_box - max(one, other) * per_flank
    found = 0
    for k in range(count):
        r = response[k]
        if r < threshold:
            continue
        if (k > 0 and response[k - 1] > r) or (k + 1 < count and response[k + 1] >= r):
            continue
        # insert in descending order of response
        place = found if found < out.shape[0] else out.shape[0]
        while place > 0 and out[place - 1, 1] < r:
            if place < out.shape[0]:
                out[place, 0], out[place, 1] = out[place - 1, 0], out[place - 1, 1]
            place -= 1
        if place < out.shape[0]:
            out[place, 0], out[place, 1] = k, r
            found = min(found + 1, out.shape[0])
    per_pixel = 1.0 / stack
    for m in range(found):
        k = int(out[m, 0])
        one = (sums[k + flank] - sums[k]) * per_flank
        other = (sums[k + box + 2 * reach] - sums[k + box + reach + 1]) * per_flank
        floor = max(one, other) + 0.25 * out[m, 1]
        weight, moment = 0.0, 0.0
        for j in range(k + reach - 1, k + reach + box + 1):
            above = (sums[j + 1] - sums[j]) * per_pixel - floor
            if above > 0.0:
                weight += above
                moment += above * j
        out[m, 0] = base + moment / weight
        out[m, 1] /= threshold
    return found
