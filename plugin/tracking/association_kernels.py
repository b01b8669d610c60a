"""Kernels of the gate and of the competing pairs, for the whole fleet."""

import math

import numpy as np

from plugin.tracking.kalman_kernels import MEASURED, cholesky, mahalanobis
from sumo_net.compile import kernel
from sumo_net.frames import wrap_angle


@kernel
def _definite(S):  # type: ignore[no-untyped-def]
    """Whether S (3, 3) is finite and positive definite, by its leading minors."""
    a, b, c = S[0, 0], S[1, 1], S[2, 2]
    d, e, f = S[0, 1], S[0, 2], S[1, 2]
    second = a * b - d * d
    third = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    return a > 0.0 and second > 0.0 and third > 0.0 and math.isfinite(third)


@kernel
def gate_pairs(z_pred, S, track_label, track_owner, z, label, owner, angle, gate, label_gate):  # type: ignore[no-untyped-def]
    """All (track, detection) pairs of one vehicle with yᵀ S⁻¹ y ≤ gate, in order of track and detection.

    Tracks z_pred (T, 3), S (T, 3, 3) and detections z (D, 3) are sorted by vehicle: track_owner (T,) and
    owner (D,). Labelled ones (-1: no label) pair only with their own label, within `label_gate`.
    Gives track, detection, squared distance (E,), and which S (T,) are not finite or not positive definite.
    """
    tracks, m = len(z_pred), MEASURED
    room = max(16, 2 * tracks)
    of_track, of_detection = np.empty(room, np.int64), np.empty(room, np.int64)
    distance = np.empty(room)
    lost, used = np.empty(tracks, np.bool_), 0
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
        lost[t] = not _definite(S[t])
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
    return of_track[:used], of_detection[:used], distance[:used], lost


@kernel
def _grown(a, room):  # type: ignore[no-untyped-def]
    out = np.empty(room, a.dtype)
    for i in range(len(a)):  # assigning a slice takes numba 2 s more to compile
        out[i] = a[i]
    return out


@kernel
def competing(track, detection, distance, cost, detections, tracks_a_block):  # type: ignore[no-untyped-def]
    """Pairs without competitors are chosen; all others go into small dense blocks.

    Pairs (E,) as `gate_pairs` gives them; cost (T,) of leaving a track without detection. Gives chosen (T,),
    -1 for none; the competing tracks (C,); the blocks' gains, cost - distance where a pair is in the gate and
    0 elsewhere, one after the other; and the blocks (B, 4): first competing track and how many, first
    detection and how many. No track or detection is in two blocks. A block ends where it has at least
    `tracks_a_block` tracks and none of its detections is in another pair.
    """
    chosen = np.full(len(cost), -1, np.int64)
    of_track, of_detection = np.zeros(len(cost), np.int64), np.zeros(detections, np.int64)
    for e in range(len(track)):
        of_track[track[e]] += 1
        of_detection[detection[e]] += 1
    pairs, rest = np.empty(len(track), np.int64), 0
    for e in range(len(track)):
        if of_track[track[e]] == 1 and of_detection[detection[e]] == 1:
            chosen[track[e]] = detection[e]
        else:
            pairs[rest] = e
            rest += 1
    least = np.empty(rest + 1, np.int64)  # smallest detection from this pair on
    least[rest] = detections
    for k in range(rest - 1, -1, -1):
        least[k] = min(least[k + 1], detection[pairs[k]])
    rows, blocks, row = np.empty(rest, np.int64), np.empty((rest, 4), np.int64), np.empty(rest, np.int64)
    used, count, room, last, open_ = 0, 0, 0, -1, False
    for k in range(rest):
        e = pairs[k]
        new = k == 0 or track[e] != track[pairs[k - 1]]
        if open_ and new and least[k] > last and blocks[count, 1] >= tracks_a_block:
            room += blocks[count, 1] * blocks[count, 3]
            count += 1
            open_ = False
        if not open_:
            blocks[count, 0], blocks[count, 1], blocks[count, 2] = used, 0, least[k]
            open_, last = True, -1
        if new:
            rows[used] = track[e]
            used += 1
            blocks[count, 1] += 1
        row[k] = used - 1
        last = max(last, detection[e])
        blocks[count, 3] = last - blocks[count, 2] + 1
    if open_:
        room += blocks[count, 1] * blocks[count, 3]
        count += 1
    gains, block, begin = np.zeros(room), 0, 0
    for k in range(rest):
        if row[k] == blocks[block, 0] + blocks[block, 1]:
            begin += blocks[block, 1] * blocks[block, 3]
            block += 1
        first, _, low, width = blocks[block]
        t, d = rows[row[k]], detection[pairs[k]]
        gains[begin + (row[k] - first) * width + d - low] = cost[t] - distance[pairs[k]]
    return chosen, rows[:used], gains, blocks[:count]


@kernel
def unclaimed(track, detection, chosen, confirmed, detections):  # type: ignore[no-untyped-def]
    """The detections (B,) that no track has chosen (T,) or suppresses.

    A confirmed track that has a detection suppresses the others in its gate: they are points of its body.
    """
    free = np.ones(detections, np.bool_)
    for t in range(len(chosen)):
        if chosen[t] >= 0:
            free[chosen[t]] = False
    for e in range(len(track)):
        if confirmed[track[e]] and chosen[track[e]] >= 0:
            free[detection[e]] = False
    out, count = np.empty(detections, np.int64), 0
    for d in range(detections):
        if free[d]:
            out[count] = d
            count += 1
    return out[:count]
