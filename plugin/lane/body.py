"""A vehicle ahead in the own lane, detected in one frame: what it hides is not searched for paint."""

import math

import numpy as np

from plugin.lane.road_model import LEFT, RIGHT
from sumo_net.compile import kernel

BODY_CONTRAST, BODY_SHARE = 20.0, 0.25  # least difference to the road: grey levels, and share of its grey
BODY_MARGIN_PX = 4


@kernel
def body_ahead(frame, rows, work):  # type: ignore[no-untyped-def]
    """A vehicle in the own lane: (row index from which on it hides the road, first column, last column).

    Where the middle of the lane differs from the road below for two rows and over the width of a vehicle,
    there is a body; its edges and lamps are not paint. Without one, the index is the number of rows.
    """
    height, width = frame.shape
    road, strange = -1.0, 0
    for r in range(rows.shape[0]):
        left, right = work.border[LEFT, r, 0], work.border[RIGHT, r, 0]
        if math.isnan(left) or math.isnan(right):
            continue
        low, high = int(left + 0.4 * (right - left)), int(left + 0.6 * (right - left)) + 1
        if low < 1 or high > width - 1 or high - low < 2:
            continue
        line = frame[height - 1 - int(rows[r])]
        total = np.int32(0)
        for j in range(low, high):
            total += np.int32(line[j])
        grey = total / (high - low)
        apart = max(BODY_CONTRAST, BODY_SHARE * road)
        if road < 0.0 or abs(grey - road) < apart:
            road = grey if road < 0.0 else 0.7 * road + 0.3 * grey
            strange = 0
            continue
        strange += 1
        if strange < 2:
            continue
        first, last = low, high
        while first > 1 and abs((line[first - 1] + float(line[first])) * 0.5 - road) > 0.5 * apart:
            first -= 1
        while last < width - 2 and abs((line[last + 1] + float(line[last])) * 0.5 - road) > 0.5 * apart:
            last += 1
        lane = right - left
        if 0.25 * lane < last - first < 0.9 * lane:
            return r - 1, first - BODY_MARGIN_PX, last + BODY_MARGIN_PX
        road, strange = grey, 0  # a shadow across the road
    return rows.shape[0], 0, 0
