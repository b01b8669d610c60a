"""The gate over the whole fleet."""

import math

import numpy as np

from plugin.tracking.kalman_kernels import MEASURED, cholesky, mahalanobis
from sumo_net.compile import kernel
from sumo_net.frames import wrap_angle


@kernel
def gate_pairs(z_pred, S, track_label, track_first, z, label, first, angle, gate, label_gate):  # type: ignore[no-untyped-def]
    """All (track, detection) pairs of one vehicle with yᵀ S⁻¹ y ≤ gate, in order of track and detection.

    Tracks z_pred (T, 3), S (T, 3, 3) and detections z (D, 3) are sorted by vehicle; vehicle v has the tracks
    track_first[v]:track_first[v + 1] and the detections first[v]:first[v + 1]. Where labels (-1: none) are
    given only equal ones pair, within `label_gate`. Gives track (E,), detection (E,), distance squared (E,).
    """
    tracks, m = len(z_pred), MEASURED
    room = max(16, 2 * tracks)
    of_track, of_detection = np.empty(room, np.int64), np.empty(room, np.int64)
    distance = np.empty(room)
    used = 0
    L, y, w = np.empty((m, m)), np.empty(m), np.empty(m)
    for v in range(len(first) - 1):
        if first[v] == first[v + 1]:
            continue
        for t in range(track_first[v], track_first[v + 1]):
            limit = gate if track_label[t] < 0 else label_gate
            definite = cholesky(S[t], L)
            for d in range(first[v], first[v + 1]):
                if not definite or track_label[t] != label[d]:
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
