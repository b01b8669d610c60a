"""Kernel that rounds the tables' numbers and marks missing ones."""

import math

import numpy as np

from sumo_net.compile import kernel


@kernel
def rounded(values, scale):  # type: ignore[no-untyped-def]
    """values (N,) rounded to multiples of 1 / scale, without "-0"; which are finite; how many are not.

    The second is Arrow's validity bitmap, (⌈N/8⌉,) uint8: one bit a value, the first in the lowest bit.
    """
    out, known = np.empty(len(values)), np.zeros((len(values) + 7) // 8, np.uint8)
    for i in range(len(values)):
        out[i] = np.rint(values[i] * scale) / scale + 0.0
    missing = 0
    for i in range(len(values)):
        if math.isfinite(out[i]):
            known[i >> 3] |= np.uint8(1 << (i & 7))
        else:
            missing += 1
    return out, known, missing
