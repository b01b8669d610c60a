"""Kernels of the tracker: check of its input; which tracks are kept, confirmed, and their classes."""

import math
from typing import NamedTuple

import numpy as np

from plugin.tracking.classification_kernels import ClassRules, advance
from sumo_net.compile import kernel


class TrackRules(NamedTuple):
    """The tracker's settings as kernels take them."""

    confirm_hits: int
    confirm_scans: int
    coast_s: float
    nearest_m: float
    furthest_m: float
    fastest_mps: float
    classes: ClassRules


@kernel
def examine(detections, dt, coast):  # type: ignore[no-untyped-def]
    """Whether detections and dt (n,) are valid, whether sorted by owner, whether some dt exceeds coast."""
    fit, sorted_, gap = True, True, False
    for d in range(len(detections.owner)):
        z = detections.range_m[d] + detections.range_rate_mps[d] + detections.azimuth_rad[d]
        fit = fit and math.isfinite(z)
        sorted_ = sorted_ and (d == 0 or detections.owner[d] >= detections.owner[d - 1])
    for i in range(len(dt)):
        fit = fit and dt[i] >= 0.0
        gap = gap or dt[i] > coast
    return fit, sorted_, gap


@kernel
def _hits(history):  # type: ignore[no-untyped-def]
    count = 0
    while history:
        count += history & 1
        history >>= 1
    return count


@kernel
def _jumped(t, tracks, begun):  # type: ignore[no-untyped-def]
    """Whether a detection that starts a track has the label of track t."""
    for b in range(len(begun.owner)):
        if begun.owner[b] == tracks.owner[t] and begun.label[b] == tracks.label[t]:
            return True
    return False


@kernel
def settle(tracks, classes, next_id, chosen, begun, place, order, estimates, dt, moving, rules):  # type: ignore[no-untyped-def]
    """The tracks after a scan: those kept and the new ones, by owner, the new ones last.

    tracks, classes : Tracks (T,) before and their ClassState; next_id (n,). chosen (T,) : index in the
    sorted detections, or -1; order (D,) : their indices before sorting. begun : Detections (B,) that start
    tracks, by owner; place (B,) : their indices in the sorted ones. estimates (10, T + B) : the parts of an
    Estimate. dt (n,) s, moving (n,) : V_t. Gives the parts of Tracks and of ClassState, next_id, the
    detections taken (before sorting), and the estimates and rows in T + B of these tracks.
    """
    T, B = len(chosen), len(place)
    history, unseen, confirmed = np.empty(T, np.int64), np.empty(T), np.empty(T, np.bool_)
    alive, kept = np.empty(T, np.bool_), B
    for t in range(T):
        seen = chosen[t] >= 0
        history[t] = ((tracks.history[t] << 1) | seen) & ((1 << rules.confirm_scans) - 1)
        hits = _hits(history[t])
        unseen[t] = 0.0 if seen else tracks.unseen_s[t] + dt[tracks.owner[t]]
        confirmed[t] = tracks.confirmed[t] or hits >= rules.confirm_hits
        chances = max(rules.confirm_scans - tracks.age[t] - 1, 0)
        hopeful = confirmed[t] or hits + chances >= rules.confirm_hits
        distance = estimates[0, t]  # NaN fails every comparison
        near = distance > rules.nearest_m and distance < rules.furthest_m
        slow = abs(estimates[5, t]) + abs(estimates[6, t]) < rules.fastest_mps
        alive[t] = hopeful and unseen[t] <= rules.coast_s + 1e-9 and near and slow
        if alive[t] and tracks.label[t] >= 0 and not seen:
            alive[t] = not _jumped(t, tracks, begun)
        kept += alive[t]
    row, owner, track_id = np.empty(kept, np.int64), np.empty(kept, np.int64), np.empty(kept, np.int64)
    label, age, restarts = np.empty(kept, np.int64), np.empty(kept, np.int64), np.empty(kept, np.int64)
    history_, unseen_, confirmed_ = np.empty(kept, np.int64), np.empty(kept), np.empty(kept, np.bool_)
    state, candidate = np.zeros(kept, np.int8), np.zeros(kept, np.int8)
    cycles, detection = np.zeros(kept, np.int8), np.empty(kept, np.int64)
    out, threshold, next_id = np.empty((len(estimates), kept)), np.empty(kept), next_id.copy()
    t, b = 0, 0
    for k in range(kept):
        while t < T and not alive[t]:
            t += 1
        if t < T and (b == B or tracks.owner[t] <= begun.owner[b]):
            row[k], owner[k], track_id[k] = t, tracks.owner[t], tracks.track_id[t]
            label[k], age[k], restarts[k] = tracks.label[t], tracks.age[t] + 1, tracks.restarts[t]
            history_[k], unseen_[k], confirmed_[k] = history[t], unseen[t], confirmed[t]
            state[k], candidate[k] = classes.state[t], classes.candidate[t]
            cycles[k] = classes.cycles[t]
            detection[k] = order[chosen[t]] if chosen[t] >= 0 else -1
            t += 1
        else:  # a given target is confirmed at once: its association is certain
            row[k], owner[k], track_id[k] = T + b, begun.owner[b], next_id[begun.owner[b]]
            label[k], age[k], restarts[k] = begun.label[b], 1, 0
            history_[k], unseen_[k] = 1, 0.0
            confirmed_[k] = begun.label[b] >= 0 or rules.confirm_hits == 1
            detection[k] = order[place[b]]
            next_id[begun.owner[b]] += 1
            b += 1
        for part in range(len(estimates)):
            out[part, k] = estimates[part, row[k]]
        threshold[k] = moving[owner[k]]
    advance(state, candidate, cycles, out[5], detection >= 0, threshold, rules.classes)
    return (
        (owner, track_id, label, age, history_, unseen_, confirmed_, restarts),
        (state, candidate, cycles),
        next_id,
        detection,
        out,
        row,
    )
