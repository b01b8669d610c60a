"""Whether a lane found by a new search (the rival) may replace the one that is tracked.

A search without prior sometimes takes shadows, the lines of a neighbouring lane or a row of vehicles for the
lane, mostly while the true one is hardly in the image: in the middle of a lane change. A lane tracked for
long is more certain than that, even while nothing of it is seen: vehicle and lane cannot have moved by more
than the prediction's covariance allows. A rival that contradicts it has to be confirmed first: it must be the
same lane in several searches in a row.
"""

import math

from plugin.lane.road_model import HEADING, OFFSET, WIDTH
from sumo_net.compile import kernel

LOOKS, ASIDE, TURNED = 0, 1, 2  # of a rival: searches in a row; offset and heading minus the tracked lane's
RIVAL = 3


@kernel
def contradicts(fresh, x, P, t):  # type: ignore[no-untyped-def]
    """Whether the state `fresh` contradicts the prediction x ± P.

    Offsets that differ by a multiple of the lane width are the same place, seen from a neighbouring lane.
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
    """Whether `fresh` is the same lane as x within the scatter of searches; False where x is NaN."""
    return bool(
        abs(fresh[OFFSET] - x[OFFSET]) < t.rival_m
        and abs(fresh[HEADING] - x[HEADING]) < t.rival_rad
        and abs(fresh[WIDTH] - x[WIDTH]) < t.rival_width_m
    )


@kernel
def carry(rival, advance):  # type: ignore[no-untyped-def]
    """Predict a rival over a step: the same motion changes the offset to each lane by its own heading."""
    if rival[LOOKS] > 0.0:
        rival[ASIDE] += advance * rival[TURNED]


@kernel
def prove(rival, fresh, x, looks, t):  # type: ignore[no-untyped-def]
    """Count one more search that found the rival `fresh`; True once `looks` in a row found the same."""
    aside, turned = fresh[OFFSET] - x[OFFSET], fresh[HEADING] - x[HEADING]
    same = abs(aside - rival[ASIDE]) < t.rival_m and abs(turned - rival[TURNED]) < t.rival_rad
    rival[LOOKS] = rival[LOOKS] + 1.0 if rival[LOOKS] > 0.0 and same else 1.0
    rival[ASIDE], rival[TURNED] = aside, turned
    return rival[LOOKS] >= looks
