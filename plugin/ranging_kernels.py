"""Kernels of the radar chain's ends: where tracks will be in the next step, for the camera."""

import math

import numpy as np

from plugin.tracking.classification_kernels import STATIONARY, UNCLASSIFIED
from sumo_net.compile import kernel


@kernel
def _next_place(e, t, speed, turn, step):  # type: ignore[no-untyped-def]
    """(x, y) of track t of the Estimate e in the axes of the next step, after a turn by `turn`."""
    x, y = e.x_m[t], e.y_m[t]
    return x + (e.vx_mps[t] - speed) * step + turn * y, y + e.vy_mps[t] * step - turn * x


@kernel
def bodies(tracks, unseen, speed, yaw_rate, step, lately, moving):  # type: ignore[no-untyped-def]
    """Owner (B,) and next place, x and y (B,), of the vehicles among the tracks (TrackList).

    Those are confirmed, not unseen (T,) for longer than `lately` s, and not standing or, where there is no
    class yet, faster than `moving`. speed, yaw_rate (n,) of the vehicles.
    """
    count, e = len(tracks.owner), tracks.estimate
    owner, x, y, used = np.empty(count, np.int64), np.empty(count), np.empty(count), 0
    for t in range(count):
        state = tracks.motion_state[t]
        moves = abs(e.vx_mps[t]) > moving if state == UNCLASSIFIED else state != STATIONARY
        if tracks.confirmed[t] and moves and unseen[t] <= lately:
            i = tracks.owner[t]
            owner[used] = i
            x[used], y[used] = _next_place(e, t, speed[i], yaw_rate[i] * step, step)
            used += 1
    return owner[:used], x[:used], y[:used]


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
