"""Kernel of the tables' numbers: rounded, and where there is none."""

import math

import numpy as np

from sumo_net.compile import kernel


@kernel
def rounded(values, scale):  # type: ignore[no-untyped-def]
    """values (N,) to whole parts of 1 / scale, no "-0" among them; where they are finite; how many are not.

    The second is Arrow's: a bit a value, (⌈N/8⌉,) uint8, the first in the lowest bit.
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
