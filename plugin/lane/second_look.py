"""A second look: the lane that is followed against one from a search of the frame without prior knowledge.

Kernels here work on row i of the trackers' state `new`, in place.
"""

import numpy as np

from plugin.lane.evidence import of_usual_width, support_of
from plugin.lane.follow import LOCKED, SEARCHING, TENTATIVE
from plugin.lane.own_turn import trust
from plugin.lane.rival import LOOKS, contradicts, prove
from plugin.lane.road_model import OFFSET, WIDTH
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_matrix, copy_vector

NEXT_LANE_M = 0.9


@kernel
def due(i, doubtful, new, t):  # type: ignore[no-untyped-def]
    """Whether to take a second look.

    Several times after a start, which may have been wrong; every 50 frames later; more often while less of
    the lane is seen than usual (`doubtful`), while its width is unusual, while it is not seen, and while
    there is a rival.
    """
    status, age, misses = new.status[i], new.age[i], new.misses[i]
    if status == SEARCHING:
        return False
    if new.rival[i, LOOKS] > 0.0 or status == TENTATIVE or age == 2 or age == 5 or age == 12 or age == 25:
        return True
    if (doubtful or not of_usual_width(new.x[i], t)) and age % 3 == 0:
        return True
    return age % 50 == 0 or (misses > 0 and misses % 4 == 0)


@kernel
def support(i, frame, seen, odd, new, t, work):  # type: ignore[no-untyped-def]
    """Rows that support the lane; fewer while it is not proven or is `odd` (contradicts the yaw rate)."""
    x = new.x[i]
    rows = support_of(x, t, work) if seen else 0
    if odd or new.proof[i] < t.proven_frames:
        rows = int(rows * trust(x, new.phase[i], frame.speed, frame.yaw_rate, t.usual_turn))
    return rows


@kernel
def replace(i, fresh, least, found, covariance, new, t):  # type: ignore[no-untyped-def]
    """Replace the lane by the one that a search has found, if that has more support and has proved itself.

    fresh: rows that support `found` (STATES,); least: what they must exceed. Returns whether it was replaced.
    """
    x, rival = new.x[i], new.rival[i]
    aside = abs(abs(found[OFFSET] - x[OFFSET]) - x[WIDTH])
    beside = new.misses[i] == 0 and aside < NEXT_LANE_M  # the same lines, assigned to the next lane
    better = fresh > least and not beside
    odder = of_usual_width(x, t) and not of_usual_width(found, t)
    # the younger a lane, the fewer searches suffice against it
    looks = min(t.odd_looks if odder else t.rival_looks, new.proof[i] // 2)
    if better and looks > 0 and contradicts(found, x, new.P[i], t):
        better = prove(rival, found, x, looks, t)
        if better:
            new.proof[i] = 0
    else:
        rival[LOOKS] = max(rival[LOOKS] - 1.0, 0.0)
    if better:
        copy_vector(found, x)
        copy_matrix(covariance, new.P[i])
        new.phase[i], new.misses[i], rival[LOOKS] = 0.0, 0, 0.0
        new.unseen_m[i, :] = np.inf
        if fresh >= t.lock_rows:
            new.status[i] = LOCKED
    return better
