"""One frame of the default lane tracker over a fleet; its results in the image and as an estimate."""

import math

import numpy as np

from plugin.lane import second_look
from plugin.lane.follow import LOCKED, SEARCHING, TENTATIVE, Frame, Seen, follow
from plugin.lane.hidden import outline
from plugin.lane.lane_start import Given, start
from plugin.lane.own_turn import contradicted, open_road
from plugin.lane.refine_fit import farthest_found, nearest_found, tally
from plugin.lane.road_model import (
    FURTHEST_M,
    HEADING,
    LEFT,
    NODES,
    OFFSET,
    PITCH,
    RIGHT,
    WIDTH,
    border_columns,
    curvature_at,
    ground_of_rows,
    preview,
    trace,
)
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_matrix, copy_vector

REACH_M = FURTHEST_M  # reach of the model, the upper bound of settings


@kernel
def step_kernel(frames, left, right, given, hidden, old, rows, p, speed, yaw_rate, t, work, room, new, out):  # type: ignore[no-untyped-def]
    """One frame for every vehicle: state `old` -> `new`, LaneEstimate arrays in `out`."""
    for i in range(frames.shape[0]):
        frame = Frame(frames[i], speed[i], yaw_rate[i])
        _carry_over(i, speed[i] * t.step_s, old, new)
        copy_matrix(hidden[i], work.hidden)
        outline(frames[i], work.hidden, p)
        if new.status[i] == SEARCHING:
            there = Given(given[i], left[i], right[i])
            none = np.int64(0)
            support = start(frame, there, 0.0, none, room.nowhere, rows, p, t, work, room, new.x[i], new.P[i])
            seen = _begin(i, support, new, t, work)
        else:
            seen = follow(i, frame, old, new, rows, p, t, work, room)
        any_seen = seen.left or seen.right
        if any_seen:
            new.reach_m[i] = max(farthest_found(rows, new.x[i], p, work), new.reach_m[i])
        _note_near(i, seen.left, seen.right, new, rows, p, t, work)
        odd = _contradicts_turn(i, frame, seen, new, t)
        if second_look.due(i, seen.doubtful, new, t):
            support = second_look.support(i, frame, any_seen, odd, new, t, work)
            least = int(1.3 * support + 4)  # a lane from a new search must have more support than that
            proven = new.proof[i] >= t.proven_frames
            heading = new.x[i, HEADING] if proven else 0.0
            followed = new.x[i] if proven and support > 0 else room.nowhere
            there = Given(np.bool_(False), left[i], right[i])
            fresh = start(frame, there, heading, least, followed, rows, p, t, work, room, room.x, room.P)
            if second_look.replace(i, fresh, least, room.x, room.P, new, t):
                seen = Seen(True, True, seen.doubtful, seen.shift)
                _note_near(i, True, True, new, rows, p, t, work)
        new.one_sided[i] = 0 if seen.left and seen.right else new.one_sided[i] + 1
        if new.one_sided[i] > t.one_sided_frames:
            new.status[i] = SEARCHING
        if new.status[i] == SEARCHING:
            _forget(i, new)
        trace(new.x[i], new.phase[i], work.node)
        _report(i, seen, p, t, work.node, new, out)


@kernel
def _carry_over(i, advance, old, new):  # type: ignore[no-untyped-def]
    """Begin a step with the state of the last one; `advance`: metres driven since."""
    copy_vector(old.x[i], new.x[i])
    copy_matrix(old.P[i], new.P[i])
    copy_vector(old.rival[i], new.rival[i])
    for side in range(2):
        new.found[i, side], new.share[i, side] = old.found[i, side], old.share[i, side]
        new.beside[i, side] = old.beside[i, side]
        new.unseen_m[i, side] = old.unseen_m[i, side] + advance
    new.status[i], new.phase[i], new.age[i] = old.status[i], old.phase[i], old.age[i]
    new.misses[i], new.one_sided[i], new.proof[i] = old.misses[i], old.one_sided[i], old.proof[i]
    new.reach_m[i] = 0.9 * old.reach_m[i]


@kernel
def _begin(i, support, new, t, work):  # type: ignore[no-untyped-def]
    """Follow the lane that a search has found, if `support` > 0; returns what is Seen of it."""
    if support == 0:
        return Seen(False, False, False, 0)
    new.status[i] = LOCKED if support >= t.lock_rows else TENTATIVE
    new.unseen_m[i, :] = math.inf
    for side in range(2):
        found, expected = tally(work, side)
        new.share[i, side] = new.found[i, side] = found / max(expected, 1)
    return Seen(True, True, False, 0)


@kernel
def _contradicts_turn(i, frame, seen, new, t):  # type: ignore[no-untyped-def]
    """Whether a lane seen less than usual contradicts the vehicle's yaw rate; counts its proven frames."""
    x, phase = new.x[i], new.phase[i]
    odd = (
        seen.doubtful
        and new.status[i] != SEARCHING
        and contradicted(x, phase, frame.speed, frame.yaw_rate, t.odd_turn)
    )
    if odd:
        new.proof[i] = max(min(new.proof[i], t.proven_frames + t.odd_frames) - 1, 0)
        if not (seen.left or seen.right):
            open_road(new.P[i], t.odd_bend)
    else:
        new.proof[i] += int(seen.left and seen.right)
    return odd


@kernel
def _note_near(i, seen_left, seen_right, new, rows, p, t, work):  # type: ignore[no-untyped-def]
    """Where paint of a border is seen nearby, no metres have been driven since."""
    for side in range(2):
        seen = seen_left if side == LEFT else seen_right
        if seen and nearest_found(side, rows, new.x[i], p, work) <= t.near_m:
            new.unseen_m[i, side] = 0.0


@kernel
def _forget(i, new):  # type: ignore[no-untyped-def]
    """The state of a vehicle without a lane."""
    new.x[i, :], new.P[i, :, :], new.rival[i, :] = 0.0, 0.0, 0.0
    new.found[i, :], new.share[i, :], new.beside[i, :] = 0.0, 0.0, 0.0
    new.age[i], new.misses[i], new.one_sided[i], new.proof[i] = 0, 0, 0, 0
    new.phase[i], new.reach_m[i] = 0.0, 0.0


@kernel
def _report(i, seen, p, t, node, new, out):  # type: ignore[no-untyped-def]
    x, phase, status = new.x[i], new.phase[i], new.status[i]
    locked = status == LOCKED
    out.locked[i] = locked
    out.left_border_seen[i] = seen.left and locked
    out.right_border_seen[i] = seen.right and locked
    out.left_unseen_m[i], out.right_unseen_m[i] = new.unseen_m[i, LEFT], new.unseen_m[i, RIGHT]
    out.lane_shift[i] = seen.shift if locked else 0
    score = 0.0
    for side in range(2):
        score += 0.5 * min(1.0, new.found[i, side] / max(new.share[i, side], t.least_share))
    out.score[i] = score if status != SEARCHING else 0.0
    if not locked:
        out.lateral_offset_m[i] = math.nan
        out.heading_error_rad[i] = math.nan
        out.curvature_1pm[i] = math.nan
        out.curvature_rate_1pm2[i] = math.nan
        out.lane_width_m[i] = math.nan
        out.preview_offset_m[i] = math.nan
        out.preview_heading_rad[i] = math.nan
        return
    left, direction, station = preview(x, node, t.preview_m)
    out.lateral_offset_m[i] = x[OFFSET]
    out.heading_error_rad[i] = x[HEADING]
    out.curvature_1pm[i] = curvature_at(x, phase, station)
    # the secant up to twice the preview distance, which the path prediction covers
    out.curvature_rate_1pm2[i] = (curvature_at(x, phase, 2.0 * station) - curvature_at(x, phase, 0.0)) / (
        2.0 * max(station, 1.0)
    )
    out.lane_width_m[i] = x[WIDTH]
    out.preview_offset_m[i] = left
    out.preview_heading_rad[i] = direction


@kernel
def columns_kernel(x, phase, status, rows, p, furthest, out):  # type: ignore[no-untyped-def]
    """out (n, 2, rows): column of both borders at each row; NaN where out of view or unlocked."""
    # more nodes than in the fit: the curvature is constant beyond the last knot
    node, border = np.zeros((NODES + 14, 5)), np.zeros((rows.shape[0], 6))
    ground = np.zeros((rows.shape[0], 4))
    for i in range(x.shape[0]):
        out[i, :, :] = math.nan
        if status[i] != LOCKED:
            continue
        trace(x[i], phase[i], node)
        ground_of_rows(rows, x[i, PITCH], p, ground)
        for side in range(2):
            border_columns(x[i], ground, node, p, side, furthest, border)
            for r in range(rows.shape[0]):
                out[i, side, r] = border[r, 0]


@kernel
def parabola_kernel(columns, rows, width, left, right):  # type: ignore[no-untyped-def]
    """Least-squares a, b, c of x = a y² + b y + c over the rows whose column is in the image; (n, 3) each."""
    for i in range(columns.shape[0]):
        for side in range(2):
            out = left[i] if side == LEFT else right[i]
            out[:] = math.nan
            s0, s1, s2, s3, s4, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for r in range(rows.shape[0]):
                c = columns[i, side, r]
                if not (0.0 <= c <= width - 1.0):
                    continue
                y = rows[r] * 0.01
                square = y * y
                s0 += 1.0
                s1 += y
                s2 += square
                s3 += square * y
                s4 += square * square
                m0 += c
                m1 += c * y
                m2 += c * square
            if s0 < 5.0:
                continue
            # Cramer's rule for [s4 s3 s2; s3 s2 s1; s2 s1 s0] (a, b, c) = (m2, m1, m0)
            d0, d1, d2 = s2 * s0 - s1 * s1, s3 * s0 - s1 * s2, s3 * s1 - s2 * s2
            det = s4 * d0 - s3 * d1 + s2 * d2
            a = (m2 * d0 - s3 * (m1 * s0 - s1 * m0) + s2 * (m1 * s1 - s2 * m0)) / det
            b = (s4 * (m1 * s0 - s1 * m0) - m2 * d1 + s2 * (s3 * m0 - m1 * s2)) / det
            out[0], out[1] = a * 1e-4, b * 0.01
            out[2] = (m0 - b * s1 - a * s2) / s0
