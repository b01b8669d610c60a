"""One frame of the default lane tracker over a fleet: predict, collect candidates, fit, check."""

import math

import numpy as np

from plugin.lane.bends import seek_bends
from plugin.lane.evidence import (
    LEAST_JUDGED,
    of_usual_width,
    over,
    pixel_noise,
    plausible,
    share_of_paint,
    side_seen,
    support_of,
)
from plugin.lane.hidden import outline
from plugin.lane.lane_motion import predict, shift_lane
from plugin.lane.lane_start import start
from plugin.lane.own_turn import contradicted, measure, open_road, trust
from plugin.lane.refine_fit import (
    farthest_found,
    fit,
    gather,
    invert,
    nearest_found,
    predict_spread,
    tally,
)
from plugin.lane.rival import LOOKS, carry, contradicts, prove
from plugin.lane.road_model import (
    FURTHEST_M,
    HEADING,
    LEFT,
    NODES,
    OFFSET,
    OUTER_LEFT,
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

SEARCHING, TENTATIVE, LOCKED = 0, 1, 2
NEXT_LANE_M = 0.9
REACH_M = FURTHEST_M  # reach of the model, the upper bound of settings


@kernel
def second_look(status, age, misses, doubtful, odd_width):  # type: ignore[no-untyped-def]
    """Whether to compare the tracked lane with one from a new search.

    Several times after a start, which may have been wrong; every 50 frames later; more often while less of
    the lane is seen than usual (`doubtful`), while its width is unusual, and while it is not seen.
    """
    if status == TENTATIVE or age == 2 or age == 5 or age == 12 or age == 25:
        return True
    if (doubtful or odd_width) and age % 3 == 0:
        return True
    return age % 50 == 0 or (misses > 0 and misses % 4 == 0)


@kernel
def step_kernel(frames, left, right, given, hidden, old, rows, p, speed, yaw_rate, t, work, room, new, out):  # type: ignore[no-untyped-def]
    """One frame for every vehicle: state `old` -> `new`, LaneEstimate arrays in `out`."""
    before, along = work.before, work.along
    for i in range(frames.shape[0]):
        x, P = new.x[i], new.P[i]
        copy_vector(old.x[i], x)
        copy_matrix(old.P[i], P)
        phase, status = old.phase[i], old.status[i]
        misses, age, proof = old.misses[i], old.age[i], old.proof[i]
        rival = new.rival[i]
        copy_vector(old.rival[i], rival)
        shift = 0
        copy_matrix(hidden[i], work.hidden)
        outline(frames[i], work.hidden, p)
        seen_left, seen_right = False, False
        expected_left, expected_right = LEAST_JUDGED, LEAST_JUDGED
        copy_vector(old.share[i], new.share[i])
        copy_vector(old.beside[i], new.beside[i])
        for side in range(2):
            new.unseen_m[i, side] = old.unseen_m[i, side] + speed[i] * t.step_s
        if status == SEARCHING:
            misses, age, proof, phase = 0, 0, 0, 0.0
            support = start(
                frames[i],
                left[i],
                right[i],
                given[i],
                0.0,
                rows,
                p,
                speed[i],
                yaw_rate[i],
                np.int64(0),
                room.nowhere,
                t,
                work,
                room,
                x,
                P,
            )
            if support > 0:
                seen_left, seen_right = True, True
                new.unseen_m[i, :] = math.inf
                status = LOCKED if support >= t.lock_rows else TENTATIVE
                for side in range(2):
                    found, expected = tally(work, side)
                    new.share[i, side] = found / max(expected, 1)
                    new.found[i, side] = found / max(expected, 1)
        else:
            age += 1
            phase = predict(x, P, phase, speed[i] * t.step_s, t)
            carry(rival, speed[i] * t.step_s)
            measure(x, P, phase, speed[i], yaw_rate[i], t.yaw_rate_std, along)
            copy_vector(x, before)
            good = invert(P, work.factor, work.prior)
            predict_spread(x, P, phase, rows, p, t, work)
            noise = pixel_noise(frames[i], rows, work)
            if good:
                gather(frames[i], rows, t, noise, work)
                for side in range(2):
                    share = share_of_paint(side + OUTER_LEFT, work)
                    if share >= 0.0:
                        new.beside[i, side] += (0.3 if share > new.beside[i, side] else 0.05) * (
                            share - new.beside[i, side]
                        )
                if abs(x[OFFSET]) > 0.5 * x[WIDTH]:
                    side = LEFT if x[OFFSET] > 0.0 else RIGHT
                    if new.beside[i, side] > t.neighbour_share and over(side, x, t):
                        shift = 1 if side == LEFT else -1
                        shift_lane(x, P, shift, t)
                        new.share[i, 1 - side] = old.share[i, side]
                        new.share[i, side] = new.beside[i, side]
                        new.beside[i, 1 - side] = max(old.share[i, 1 - side], 2.0 * t.neighbour_share)
                        new.beside[i, side] = 0.0
                        new.unseen_m[i, 1 - side] = new.unseen_m[i, side]
                        new.unseen_m[i, side] = math.inf
                        copy_vector(x, before)
                        good = invert(P, work.factor, work.prior)
                        predict_spread(x, P, phase, rows, p, t, work)
                        gather(frames[i], rows, t, noise, work)
                good = good and fit(x, phase, before, rows, p, t, 1.0, t.iterations, work)
                if good and rival[LOOKS] == 0.0:  # not while a rival is compared with the lane as it is
                    seek_bends(frames[i], x, P, phase, speed[i], before, rows, p, t, noise, work, room)
            if good:
                found_left, expected_left = tally(work, LEFT)
                found_right, expected_right = tally(work, RIGHT)
                seen_left = side_seen(found_left, expected_left, t)
                seen_right = side_seen(found_right, expected_right, t)
                good = plausible(x, speed[i], t)
                good = good and abs(x[OFFSET] - before[OFFSET]) < t.jump_m
                good = good and abs(x[HEADING] - before[HEADING]) < t.jump_rad
                good = good and invert(work.information, work.factor, P)
            if good:
                misses = 0 if seen_left or seen_right else misses + 1
                for side in range(2):
                    found, expected = (
                        (found_left, expected_left) if side == LEFT else (found_right, expected_right)
                    )
                    share = found / max(expected, 1)
                    new.found[i, side] = share
                    usual = new.share[i, side]
                    if expected >= LEAST_JUDGED:
                        new.share[i, side] = usual + (0.3 if share > usual else 0.02) * (share - usual)
                confirm = t.confirm_frames if of_usual_width(x, t) else t.odd_confirm_frames
                if status == TENTATIVE and seen_left and seen_right and age >= confirm:
                    status = LOCKED
                if misses > (t.patience_frames if status == LOCKED else t.confirm_frames):
                    status = SEARCHING
            else:
                seen_left, seen_right = False, False
                copy_vector(before, x)
                new.found[i, :] = 0.0
                misses += 1
                if status == TENTATIVE or misses > t.patience_frames or not plausible(x, speed[i], t):
                    status = SEARCHING
        seen_m = farthest_found(rows, x, p, work) if seen_left or seen_right else 0.0
        _note_near(new.unseen_m[i], seen_left, seen_right, x, rows, p, t, work)
        doubtful = np.bool_(False)
        for side in range(2):
            in_view = expected_left if side == LEFT else expected_right
            seen_lately = max(new.found[i, side], old.found[i, side])
            if in_view >= LEAST_JUDGED:
                doubtful = doubtful or seen_lately < 0.6 * new.share[i, side]
        odd = doubtful and status != SEARCHING and contradicted(x, phase, speed[i], yaw_rate[i], t.odd_turn)
        if odd:
            proof = max(min(proof, t.proven_frames + t.odd_frames) - 1, 0)
            if not (seen_left or seen_right):
                open_road(P, t.odd_bend)
        else:
            proof += int(seen_left and seen_right)
        proven = proof >= t.proven_frames
        odd_width = not of_usual_width(x, t)
        if status != SEARCHING and (
            rival[LOOKS] > 0.0 or second_look(status, age, misses, doubtful, odd_width)
        ):
            support = support_of(x, t, work) if seen_left or seen_right else 0
            if odd or not proven:
                support = int(support * trust(x, phase, speed[i], yaw_rate[i], t.usual_turn))
            least = int(1.3 * support + 4)  # a lane from a new search must have more support than that
            fresh = start(
                frames[i],
                left[i],
                right[i],
                np.bool_(False),
                x[HEADING] if proven else 0.0,
                rows,
                p,
                speed[i],
                yaw_rate[i],
                least,
                x if proven and support > 0 else room.nowhere,
                t,
                work,
                room,
                room.x,
                room.P,
            )
            aside = abs(abs(room.x[OFFSET] - x[OFFSET]) - x[WIDTH])
            beside = misses == 0 and aside < NEXT_LANE_M  # the same lines, assigned to the next lane
            better = fresh > least and not beside
            odder = not odd_width and not of_usual_width(room.x, t)
            # the younger a lane, the fewer searches suffice against it
            looks = min(t.odd_looks if odder else t.rival_looks, proof // 2)
            if better and looks > 0 and contradicts(room.x, x, P, t):
                better = prove(rival, room.x, x, looks, t)
                if better:
                    proof = 0
            else:
                rival[LOOKS] = max(rival[LOOKS] - 1.0, 0.0)
            if better:
                copy_vector(room.x, x)
                copy_matrix(room.P, P)
                phase = 0.0
                rival[LOOKS] = 0.0
                misses, seen_left, seen_right = 0, True, True
                new.unseen_m[i, :] = math.inf
                _note_near(new.unseen_m[i], seen_left, seen_right, x, rows, p, t, work)
                if fresh >= t.lock_rows:
                    status = LOCKED
        one_sided = 0 if seen_left and seen_right else old.one_sided[i] + 1
        if one_sided > t.one_sided_frames:
            status = SEARCHING
        new.one_sided[i] = one_sided if status != SEARCHING else 0
        new.phase[i], new.status[i], new.misses[i], new.age[i] = phase, status, misses, age
        new.proof[i] = proof
        if status == SEARCHING:
            new.found[i, :] = 0.0
            new.share[i, :] = 0.0
            new.beside[i, :] = 0.0
            rival[:] = 0.0
            proof = 0
            x[:] = 0.0
            P[:, :] = 0.0
        new.reach_m[i] = max(seen_m, 0.9 * old.reach_m[i]) if status != SEARCHING else 0.0
        trace(x, phase, work.node)
        _report(i, x, phase, status, seen_left, seen_right, shift, p, t, work.node, new, out)


@kernel
def _note_near(unseen, seen_left, seen_right, x, rows, p, t, work):  # type: ignore[no-untyped-def]
    """Reset the metres (2,) driven since paint of a border was seen nearby, where it is seen now."""
    for side in range(2):
        seen = seen_left if side == LEFT else seen_right
        if seen and nearest_found(side, rows, x, p, work) <= t.near_m:
            unseen[side] = 0.0


@kernel
def _report(i, x, phase, status, seen_left, seen_right, shift, p, t, node, new, out):  # type: ignore[no-untyped-def]
    locked = status == LOCKED
    out.locked[i] = locked
    out.left_border_seen[i] = seen_left and locked
    out.right_border_seen[i] = seen_right and locked
    out.left_unseen_m[i], out.right_unseen_m[i] = new.unseen_m[i, LEFT], new.unseen_m[i, RIGHT]
    out.lane_shift[i] = shift if locked else 0
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
