"""Whether a lane that is sought anew may take the place of the one that is followed.

A look from nothing now and then takes shadows, the lines of a lane beside or a row of vehicles for the lane,
mostly when the true one is hardly in the image: in the middle of a lane change. What was followed for long is
surer than that, even while nothing of it is seen: the vehicle cannot have turned, nor the lane have moved, by
more than the prediction's covariance says. Lines that contradict it must prove themselves first, by staying
the same lane in one look after the other.
"""

import math

from plugin.lane.road_model import HEADING, OFFSET, WIDTH
from sumo_net.compile import kernel

LOOKS, ASIDE, TURNED = 0, 1, 2  # of a rival: looks in a row, its offset and heading minus the followed's
RIVAL = 3


@kernel
def contradicts(fresh, x, P, t):  # type: ignore[no-untyped-def]
    """Whether the pose `fresh` cannot be that of the vehicle that was predicted to be at x ± P.

    An offset that is a lane's width away is the same place, taken for the lane beside.
    """
    width = max(x[WIDTH], t.min_width_m)
    aside = fresh[OFFSET] - x[OFFSET]
    aside -= width * math.floor(aside / width + 0.5)
    turned = fresh[HEADING] - x[HEADING]
    wider = fresh[WIDTH] - x[WIDTH]
    return bool(
        abs(aside) > t.rival_m + t.gate * math.sqrt(max(P[OFFSET, OFFSET], 0.0))
        or abs(turned) > t.rival_rad + t.gate * math.sqrt(max(P[HEADING, HEADING], 0.0))
        or abs(wider) > t.rival_width_m + t.gate * math.sqrt(max(P[WIDTH, WIDTH], 0.0))
    )


@kernel
def close(fresh, x, t):  # type: ignore[no-untyped-def]
    """Whether the pose `fresh` is that of x but for what looks differ by; False where x is NaN."""
    return bool(
        abs(fresh[OFFSET] - x[OFFSET]) < t.rival_m
        and abs(fresh[HEADING] - x[HEADING]) < t.rival_rad
        and abs(fresh[WIDTH] - x[WIDTH]) < t.rival_width_m
    )


@kernel
def carry(rival, advance):  # type: ignore[no-untyped-def]
    """Move a rival on by a step: both lanes are left behind by the same motion, along their own headings."""
    if rival[LOOKS] > 0.0:
        rival[ASIDE] += advance * rival[TURNED]


@kernel
def prove(rival, fresh, x, looks, t):  # type: ignore[no-untyped-def]
    """Count one more look that found the rival `fresh`; True once it was the same in `looks`."""
    aside, turned = fresh[OFFSET] - x[OFFSET], fresh[HEADING] - x[HEADING]
    same = abs(aside - rival[ASIDE]) < t.rival_m and abs(turned - rival[TURNED]) < t.rival_rad
    rival[LOOKS] = rival[LOOKS] + 1.0 if rival[LOOKS] > 0.0 and same else 1.0
    rival[ASIDE], rival[TURNED] = aside, turned
    return rival[LOOKS] >= looks
