"""The gate over the whole fleet, and what goes with it."""

import math

import numpy as np

from plugin.tracking.kalman_kernels import MEASURED, cholesky, mahalanobis
from sumo_net.compile import kernel
from sumo_net.frames import wrap_angle


@kernel
def gate_pairs(z_pred, S, track_label, track_owner, z, label, owner, angle, gate, label_gate):  # type: ignore[no-untyped-def]
    """All (track, detection) pairs of one vehicle with yᵀ S⁻¹ y ≤ gate, in order of track and detection.

    Tracks z_pred (T, 3), S (T, 3, 3) and detections z (D, 3) are sorted by vehicle: track_owner (T,) and
    owner (D,). Where labels (-1: none) are given only equal ones pair, within `label_gate`. Gives track (E,),
    detection (E,), distance squared (E,).
    """
    tracks, m = len(z_pred), MEASURED
    room = max(16, 2 * tracks)
    of_track, of_detection = np.empty(room, np.int64), np.empty(room, np.int64)
    distance = np.empty(room)
    used = 0
    L, y, w = np.empty((m, m)), np.empty(m), np.empty(m)
    first, end = 0, 0  # of the vehicle's detections
    for t in range(tracks):
        if t == 0 or track_owner[t] != track_owner[t - 1]:
            first = end
            while first < len(owner) and owner[first] < track_owner[t]:
                first += 1
            end = first
            while end < len(owner) and owner[end] == track_owner[t]:
                end += 1
        limit = gate if track_label[t] < 0 else label_gate
        positive = cholesky(S[t], L)
        for d in range(first, end):
            if not positive or track_label[t] != label[d]:
                continue
            inside = True
            for i in range(m):
                y[i] = z[d, i] - z_pred[t, i]
                if angle[i]:
                    y[i] = wrap_angle(y[i])
                if not y[i] * y[i] <= limit * S[t, i, i]:  # no component may exceed the gate alone
                    inside = False
                    break
            if not inside:
                continue
            squared = mahalanobis(L, y, w)
            if not squared <= limit or math.isnan(squared):
                continue
            if used == room:
                room *= 2
                of_track = _grown(of_track, room)
                of_detection = _grown(of_detection, room)
                distance = _grown(distance, room)
            of_track[used], of_detection[used], distance[used] = t, d, squared
            used += 1
    return of_track[:used], of_detection[:used], distance[:used]


@kernel
def _grown(a, room):  # type: ignore[no-untyped-def]
    out = np.empty(room, a.dtype)
    out[: len(a)] = a
    return out


@kernel
def suppressed(track, detection, chosen, confirmed, detections):  # type: ignore[no-untyped-def]
    """Which detections (D,) lie in the gate of a confirmed track that has one: points of that body."""
    out = np.zeros(detections, np.bool_)
    for e in range(len(track)):
        if confirmed[track[e]] and chosen[track[e]] >= 0:
            out[detection[e]] = True
    return out


@kernel
def definite(S):  # type: ignore[no-untyped-def]
    """Whether each S (T, 3, 3) is finite and positive definite, by its leading minors (T,)."""
    out = np.empty(len(S), np.bool_)
    for t in range(len(S)):
        a, b, c = S[t, 0, 0], S[t, 1, 1], S[t, 2, 2]
        d, e, f = S[t, 0, 1], S[t, 0, 2], S[t, 1, 2]
        second = a * b - d * d
        third = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
        out[t] = a > 0.0 and second > 0.0 and third > 0.0 and math.isfinite(third)
    return out
