"""Kernels for what the camera takes from the radar: where tracks will be in the next step."""

import math

import numpy as np

from plugin.tracking.classification_kernels import STATIONARY, UNCLASSIFIED
from sumo_net.compile import kernel

VELOCITY_STD_MPS = 0.5  # of a track, across
MOST_ASKEW_RAD = 0.2  # largest angle between a body and the road
CROSSING_RAD = 0.5


@kernel
def _next_place(e, t, speed, turn, step):  # type: ignore[no-untyped-def]
    """(x, y) of track t of the Estimate e in the axes of the next step, after a turn by `turn`."""
    x, y = e.x_m[t], e.y_m[t]
    return x + (e.vx_mps[t] - speed) * step + turn * y, y + e.vy_mps[t] * step - turn * x


@kernel
def bodies(tracks, unseen, speed, yaw_rate, step, lately, moving):  # type: ignore[no-untyped-def]
    """Owner, next x and y, axis and its standard deviation, (B,) each, of the vehicles among the tracks.

    tracks: TrackList. Vehicles are tracks that are confirmed, not unseen (T,) for longer than `lately` s, and
    not stationary or, without a class yet, faster than `moving`. speed, yaw_rate (n,) of the own vehicles.
    """
    count, e = len(tracks.owner), tracks.estimate
    owner, x, y, used = np.empty(count, np.int64), np.empty(count), np.empty(count), 0
    course, course_std = np.empty(count), np.empty(count)
    for t in range(count):
        state = tracks.motion_state[t]
        moves = abs(e.vx_mps[t]) > moving if state == UNCLASSIFIED else state != STATIONARY
        if tracks.confirmed[t] and moves and unseen[t] <= lately:
            i = tracks.owner[t]
            owner[used] = i
            turn = yaw_rate[i] * step
            x[used], y[used] = _next_place(e, t, speed[i], turn, step)
            course[used], course_std[used] = axis_of(e.vx_mps[t], e.vy_mps[t])
            course[used] -= turn
            used += 1
    return owner[:used], x[:used], y[:used], course[:used], course_std[:used]


@kernel
def axis_of(vx, vy):  # type: ignore[no-untyped-def]
    """(angle of a body's axis from the own one, its standard deviation) from its velocity over ground.

    For a slow or crossing body it is only known that bodies stand along the road.
    """
    pace, course = math.hypot(vx, vy), math.atan(vy / vx)
    if pace * MOST_ASKEW_RAD < VELOCITY_STD_MPS or not abs(course) < CROSSING_RAD:
        return 0.0, MOST_ASKEW_RAD
    return course, VELOCITY_STD_MPS / pace


@kernel
def rears(e, row, speed, yaw_rate, step):  # type: ignore[no-untyped-def]
    """Where the tracks `row` (n,), -1 for none, of the Estimate e are now and in the next step.

    (4, n): x, y, next x, next y, NaN for none. speed, yaw_rate (n,).
    """
    out = np.full((4, len(row)), math.nan)
    for i in range(len(row)):
        if row[i] >= 0:
            out[0, i], out[1, i] = e.x_m[row[i]], e.y_m[row[i]]
            out[2, i], out[3, i] = _next_place(e, row[i], speed[i], yaw_rate[i] * step, step)
    return out
