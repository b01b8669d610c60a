"""Kernels of the tracks' truth: which body a track belongs to, and its true motion."""

import math

import numpy as np

from plugin.tracking.classification_kernels import (
    ONCOMING,
    SAME_DIRECTION,
    STATIONARY,
    STOPPED_ONCOMING,
    STOPPED_SAME,
)
from sumo_net.compile import kernel

NOTHING = -1  # target of a track that began from clutter


@kernel
def _class_of(before, vx, moving, oncoming, near_zero):  # type: ignore[no-untyped-def]
    """The class of a body with the true speed vx (NaN changes nothing); `moving` is V_t."""
    if vx > moving:
        return SAME_DIRECTION
    if vx < oncoming:
        return ONCOMING
    if abs(vx) < near_zero and before == SAME_DIRECTION:
        return STOPPED_SAME
    if abs(vx) < near_zero and before == ONCOMING:
        return STOPPED_ONCOMING
    return before


@kernel
def follow(handle, tracks, place, behind, objects, before, moving, oncoming, near_zero):  # type: ignore[no-untyped-def]
    """The bodies that T tracks of n vehicles, with handles (n,), follow after a scan.

    tracks : TrackList. place : row and column in `behind`, a ScanTruth, of each detection. objects : Objects,
    (n, M). before : Followed, in the order of its keys. moving (n,) : V_t, oncoming and near_zero as in
    ClassSettings. Gives key, target, class (T,) as in Followed, the class to show, -1 where unknown, and
    floats (6, T): true range, range rate, azimuth of the detection's point, v_x and v_y of the body, and
    the track's own time to collision; NaN where there is none.
    """
    count = len(tracks.owner)
    key, target = np.empty(count, np.int64), np.empty(count, np.int64)
    true_class, shown = np.empty(count, np.int8), np.empty(count, np.int8)
    floats = np.empty((6, count))
    at = 0
    for t in range(count):
        owner, detection = tracks.owner[t], tracks.detection[t]
        key[t] = (handle[owner] << 32) | tracks.track_id[t]
        body, now = NOTHING, STATIONARY
        while at < len(before.key) and before.key[at] < key[t]:
            at += 1
        if at < len(before.key) and before.key[at] == key[t]:
            body, now = before.target[at], int(before.true_class[at])
        for k in range(5):
            floats[k, t] = math.nan
        if detection >= 0:
            i, j = place[0][detection], place[1][detection]
            floats[0, t], floats[1, t] = behind.range_m[i, j], behind.range_rate_mps[i, j]
            floats[2, t] = behind.azimuth_rad[i, j]
            taken = behind.handle[i, j]
            if taken != NOTHING:  # a track that is assigned clutter still follows its body
                if body != taken:
                    now = STATIONARY
                body = taken
        if body != NOTHING:
            for m in range(objects.handle.shape[1]):
                if objects.handle[owner, m] == body:
                    speed, heading = objects.speed_mps[owner, m], objects.heading_rad[owner, m]
                    floats[3, t], floats[4, t] = speed * math.cos(heading), speed * math.sin(heading)
                    break
        now = _class_of(now, floats[3, t], moving[owner], oncoming, near_zero)
        target[t], true_class[t] = body, now
        shown[t] = now if body != NOTHING and math.isfinite(floats[3, t]) else -1
        closing = -tracks.estimate.range_rate_mps[t]
        floats[5, t] = tracks.estimate.range_m[t] / max(closing, 1e-9) if closing > 0.0 else math.nan
    return key, target, true_class, shown, floats


@kernel
def rows(handle, tracks, inside, target, shown, floats, chosen):  # type: ignore[no-untyped-def]
    """The `chosen` (T,) tracks' rows of the table `tracks`: numbers (16, K) and codes (8, K) int64.

    The first are an Estimate and the floats of `follow`, in this order; the second handle, target, track_id,
    restarts, measured, in_path (inside), motion_state and true_motion_state (shown).
    """
    count = 0
    for t in range(len(chosen)):
        count += chosen[t]
    numbers, codes = np.empty((16, count)), np.empty((8, count), np.int64)
    k, e = 0, tracks.estimate
    for t in range(len(chosen)):
        if not chosen[t]:
            continue
        numbers[0, k], numbers[1, k], numbers[2, k] = e.range_m[t], e.range_rate_mps[t], e.azimuth_rad[t]
        numbers[3, k], numbers[4, k], numbers[5, k] = e.x_m[t], e.y_m[t], e.vx_mps[t]
        numbers[6, k], numbers[7, k], numbers[8, k] = e.vy_mps[t], e.ax_mps2[t], e.ay_mps2[t]
        numbers[9, k] = e.probability_cv[t]
        for part in range(6):
            numbers[10 + part, k] = floats[part, t]
        codes[0, k], codes[1, k], codes[2, k] = handle[tracks.owner[t]], target[t], tracks.track_id[t]
        codes[3, k], codes[4, k], codes[5, k] = tracks.restarts[t], tracks.detection[t] >= 0, inside[t]
        codes[6, k], codes[7, k] = tracks.motion_state[t], shown[t]
        k += 1
    return numbers, codes
