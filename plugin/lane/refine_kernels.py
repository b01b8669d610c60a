"""One frame of the default lane tracker over a fleet: predict, look, fit, judge."""

import math
from typing import Any, NamedTuple

import numpy as np

from plugin.lane.acquire import (
    HALF_BINS,
    PER_SEGMENT,
    SEGMENTS,
    STARTS,
    initial_covariance,
    lane_start,
    parabola_as_candidates,
    ridge_points,
    vote,
)
from plugin.lane.refine_fit import (
    cholesky,
    farthest_found,
    fit,
    gather,
    invert,
    odds_of_paint,
    place_borders,
    predict_spread,
    solve,
    tally,
    workspace,
)
from plugin.lane.ridge import road_noise
from plugin.lane.road_model import (
    FURTHEST_M,
    HEADING,
    KNOT,
    KNOTS,
    LEFT,
    LINES,
    NEXT_LEFT,
    NEXT_RIGHT,
    NODES,
    OFFSET,
    OUTER_LEFT,
    OUTER_RIGHT,
    PITCH,
    RIGHT,
    SPACING_M,
    STATES,
    TURN,
    WIDTH,
    border_columns,
    curvature_at,
    ground_of_rows,
    preview,
    trace,
)
from sumo_net.compile import kernel

Array = np.ndarray[Any, Any]

SEARCHING, TENTATIVE, LOCKED = 0, 1, 2

NEIGHBOUR_DIFFERENCE = 2.0 / math.sqrt(math.pi)  # mean |a - b| of two normal draws of deviation 1


@kernel
def predict(x, P, phase, advance, t):  # type: ignore[no-untyped-def]
    """Move state and covariance on by one step in which the vehicle drove `advance` metres; returns phase."""
    T = t.step_s
    keep = math.exp(-T / t.turn_time_s)
    drift = advance * T * 0.5
    x[OFFSET] += advance * x[HEADING] + drift * x[TURN]
    x[HEADING] += T * x[TURN]
    x[TURN] *= keep
    x[PITCH] *= t.pitch_keep
    for j in range(NEXT_LEFT, NEXT_RIGHT + 1):
        # neighbouring lanes are as wide as this one, more or less
        x[j] = x[WIDTH] + t.next_keep * (x[j] - x[WIDTH])
        P[j, :] *= t.next_keep
        P[:, j] *= t.next_keep
        P[j, j] += t.next_std * t.next_std * (1.0 - t.next_keep * t.next_keep)
    for j in range(STATES):
        P[OFFSET, j] += advance * P[HEADING, j] + drift * P[TURN, j]
        P[HEADING, j] += T * P[TURN, j]
        P[TURN, j] *= keep
        P[PITCH, j] *= t.pitch_keep
    for i in range(STATES):
        P[i, OFFSET] += advance * P[i, HEADING] + drift * P[i, TURN]
        P[i, HEADING] += T * P[i, TURN]
        P[i, TURN] *= keep
        P[i, PITCH] *= t.pitch_keep
    phase += advance
    while phase >= SPACING_M:
        phase -= SPACING_M
        _drop_knot(x, P, t)
    P[OFFSET, OFFSET] += t.offset_walk * t.offset_walk
    P[HEADING, HEADING] += t.heading_walk * t.heading_walk
    P[WIDTH, WIDTH] += t.width_walk * t.width_walk
    P[TURN, TURN] += t.turn_std * t.turn_std * (1.0 - keep * keep)
    P[PITCH, PITCH] += t.pitch_std * t.pitch_std * (1.0 - t.pitch_keep * t.pitch_keep)
    for j in range(KNOT, KNOT + KNOTS):
        P[j, j] += t.knot_walk * t.knot_walk * advance
    return phase


@kernel
def _drop_knot(x, P, t):  # type: ignore[no-untyped-def]
    """The first knot fell behind: renumber, and append one whose curvature is the last one's ± bend_std,
    drawn a little towards a straight road."""
    last = KNOT + KNOTS - 1
    for j in range(KNOT, last):
        x[j] = x[j + 1]
    for i in range(STATES):
        for j in range(KNOT, last):
            P[i, j] = P[i, j + 1]
    for j in range(KNOT, last):
        for i in range(STATES):
            P[j, i] = P[j + 1, i]
    # a clothoid goes on as a clothoid, and every road becomes straight again
    g1, g2 = t.bend_keep + t.bend_slope, -t.bend_slope
    x[last] = g1 * x[last - 1] + g2 * x[last - 2]
    P[last, :] = g1 * P[last - 1] + g2 * P[last - 2]
    P[:, last] = g1 * P[:, last - 1] + g2 * P[:, last - 2]
    P[last, last] = g1 * P[last, last - 1] + g2 * P[last, last - 2] + t.bend_std * t.bend_std


@kernel
def shift_lane(x, P, side, t):  # type: ignore[no-untyped-def]
    """Go over to the neighbouring lane: +1 left, -1 right. All lines stay where they are.

    offset -= side (WIDTH + NEXT) / 2, the neighbour's width becomes the lane's, the lane's that of the
    neighbour on the other side; of the new neighbour nothing is known.
    """
    near, other = (NEXT_LEFT, NEXT_RIGHT) if side > 0 else (NEXT_RIGHT, NEXT_LEFT)
    half = 0.5 * side
    aside = half * (x[WIDTH] + x[near])
    x[OFFSET] -= aside
    for j in range(KNOT, KNOT + KNOTS):
        x[j] /= 1.0 - x[j] * aside  # the new centre line is an arc about the same centre
    x[other], x[WIDTH] = x[WIDTH], x[near]
    for j in range(STATES):
        P[OFFSET, j] -= half * (P[WIDTH, j] + P[near, j])
        P[other, j] = P[WIDTH, j]
        P[WIDTH, j] = P[near, j]
    for i in range(STATES):
        P[i, OFFSET] -= half * (P[i, WIDTH] + P[i, near])
        P[i, other] = P[i, WIDTH]
        P[i, WIDTH] = P[i, near]
    P[near, :] = 0.0
    P[:, near] = 0.0
    P[near, near] = t.next_std * t.next_std


@kernel
def pixel_noise(frame, rows, work):  # type: ignore[no-untyped-def]
    """Standard deviation of a pixel on the road between the borders, from neighbours' differences."""
    total, count = 0.0, 0
    for r in range(0, rows.shape[0], 4):
        left, right = work.border[LEFT, r, 0], work.border[RIGHT, r, 0]
        if math.isnan(left) or math.isnan(right):
            continue
        inset = 0.12 * (right - left)
        grain = road_noise(frame, frame.shape[0] - 1 - int(rows[r]), left + inset, right - inset)
        if not math.isnan(grain):
            total += grain
            count += 1
    return total / count / NEIGHBOUR_DIFFERENCE if count > 0 else 0.0


@kernel
def plausible(x, t):  # type: ignore[no-untyped-def]
    """Whether a state can be a car in a lane."""
    if not (t.min_width_m <= x[WIDTH] <= t.max_width_m):
        return False
    if not abs(x[HEADING]) < 0.3 or not abs(x[OFFSET]) < 0.5 * x[WIDTH] + t.outside_m:
        return False
    return abs(x[KNOT + 1]) < 0.02 and abs(x[KNOT + 3]) < 0.02 and abs(x[PITCH]) < 6.0 * t.pitch_std + 1e-6


@kernel
def side_seen(found, expected, t):  # type: ignore[no-untyped-def]
    """Whether a border counts as measured in this frame."""
    return found >= t.least_rows and found >= t.least_share * expected


@kernel
def support_of(work):  # type: ignore[no-untyped-def]
    """Rows that speak for a lane; both borders count, the weaker one decides."""
    left, _ = tally(work, LEFT)
    right, _ = tally(work, RIGHT)
    return min(left, 3 * right) + min(right, 3 * left)


@kernel
def lean_to_lane(predicted, t, work, scratch):  # type: ignore[no-untyped-def]
    """Add to the prior that a car mostly drives along its lane: heading 0 ± start_heading_std."""
    for i in range(STATES):
        scratch[i] = 0.0
        for j in range(STATES):
            scratch[i] += work.prior[i, j] * predicted[j]
    work.prior[HEADING, HEADING] += 1.0 / (t.start_heading_std * t.start_heading_std)
    if not cholesky(work.prior, work.factor):
        return False
    solve(work.factor, scratch)
    predicted[:] = scratch
    return True


@kernel
def second_look(status, age, misses):  # type: ignore[no-untyped-def]
    """Whether to compare the lane that is followed with one that is sought anew.

    Soon after a start, which may have been wrong, now and then later, and while the lane is not seen.
    """
    if status == TENTATIVE or age == 2 or age == 5 or age == 12 or age == 25:
        return True
    return age % 200 == 0 or (misses > 0 and misses % 4 == 0)


class Room(NamedTuple):
    """Work space of a start."""

    point: Array
    ridge: Array
    bins: Array
    smooth: Array
    starts: Array
    score: Array
    trial: Array
    predicted: Array
    chosen: Array
    x: Array
    P: Array
    covariance: Array
    kept: Array
    found: Array
    expected: Array


@kernel
def room_for(rows):  # type: ignore[no-untyped-def]
    """Room for `rows` image rows."""
    return Room(
        np.zeros((rows * SEGMENTS * PER_SEGMENT, 2)),
        np.zeros((PER_SEGMENT, 2)),
        np.zeros(2 * HALF_BINS + 1),
        np.zeros(2 * HALF_BINS + 1),
        np.zeros((STARTS, STATES)),
        np.zeros(STARTS),
        np.zeros(STATES),
        np.zeros(STATES),
        np.zeros(STATES),
        np.zeros(STATES),
        np.zeros((STATES, STATES)),
        np.zeros((STATES, STATES)),
        np.zeros((STATES, STATES)),
        np.zeros((LINES, rows), np.bool_),
        np.zeros((LINES, rows), np.bool_),
    )


@kernel
def start(frame, left, right, given, rows, p, t, work, room, x, P):  # type: ignore[no-untyped-def]
    """Find the lane from nothing into x, P. Returns the number of rows that support it, 0 for no lane.

    left, right: the search's a, b, c of this vehicle where `given`.
    """
    best = 0
    trial, predicted = room.trial, room.predicted
    lane_start(t, trial)
    place_borders(trial, 0.0, rows, p, t, work)
    noise = pixel_noise(frame, rows, work)
    found = ridge_points(frame, rows, p, t, noise, work, room.ridge, room.point)
    vote(room.point, found, t, room.bins, room.smooth, room.starts, room.score)
    for attempt in range(STARTS + 1):
        if attempt == STARTS:
            if not given:
                continue
            lane_start(t, trial)
            predicted[:] = trial
            initial_covariance(P, t, 1.0, 0.05, t.lane_width_std_m, 2e-3)
            if not invert(P, work.factor, work.prior):
                continue
            predict_spread(trial, P, 0.0, rows, p, t, work)
            parabola_as_candidates(left, right, rows, work)
            if not fit(trial, 0.0, predicted, rows, p, t, 1.0, 3, work):
                continue
        else:
            if room.score[attempt] <= 0.0:
                continue
            trial[:] = room.starts[attempt]
        if not plausible(trial, t):
            continue
        predicted[:] = trial
        predicted[WIDTH] = 0.5 * (predicted[WIDTH] + t.lane_width_m)
        loose = 1.0 if attempt < STARTS else 2.0
        initial_covariance(P, t, 0.15 * loose, 0.008 * loose, 0.3, 8e-4 * loose)
        if not invert(P, work.factor, work.prior):
            continue
        predict_spread(trial, P, 0.0, rows, p, t, work)
        if not lean_to_lane(predicted, t, work, room.x):
            continue
        noise = pixel_noise(frame, rows, work)
        gather(frame, rows, t, noise, work)
        if not fit(trial, 0.0, predicted, rows, p, t, 1.0, 6, work):
            continue
        # again around the first result, with what it left open
        if not invert(work.information, work.factor, room.covariance):
            continue
        predict_spread(trial, room.covariance, 0.0, rows, p, t, work)
        gather(frame, rows, t, noise, work)
        if not fit(trial, 0.0, predicted, rows, p, t, 1.0, 5, work):
            continue
        found_left, expected_left = tally(work, LEFT)
        found_right, expected_right = tally(work, RIGHT)
        if not (side_seen(found_left, expected_left, t) and side_seen(found_right, expected_right, t)):
            continue
        if not plausible(trial, t) or abs(trial[OFFSET]) > 0.5 * trial[WIDTH] + 0.3:
            continue
        support = support_of(work)
        if support > best and invert(work.information, work.factor, room.covariance):
            best = support
            room.chosen[:] = trial
            room.kept[:, :] = room.covariance
            room.found[:, :] = work.found
            room.expected[:, :] = work.expected
    if best > 0:
        x[:] = room.chosen
        P[:, :] = room.kept
        work.found[:, :] = room.found
        work.expected[:, :] = room.expected
    return best


@kernel
def share_of_paint(side, work):  # type: ignore[no-untyped-def]
    """Share of the rows in which there is paint near a line."""
    found, expected = 0, 0
    for r in range(work.expected.shape[1]):
        if work.expected[side, r]:
            expected += 1
            if work.ridges[side, r] > 0 and odds_of_paint(work.ridge[side, r, 0, 1]) > 1.0:
                found += 1
    return found / expected if expected >= 6 else 0.0


@kernel
def step_kernel(frames, left, right, given, old, rows, p, speed, t, new, out):  # type: ignore[no-untyped-def]
    """One frame for every vehicle: state `old` -> `new`, LaneEstimate arrays in `out`."""
    work = workspace(rows.shape[0])
    room = room_for(rows.shape[0])
    before = np.zeros(STATES)
    for i in range(frames.shape[0]):
        x, P = new.x[i], new.P[i]
        x[:], P[:, :] = old.x[i], old.P[i]
        phase, status = old.phase[i], old.status[i]
        misses, age = old.misses[i], old.age[i]
        shift = 0
        seen_left, seen_right = False, False
        new.share[i, :] = old.share[i]
        if status == SEARCHING:
            misses, age, phase = 0, 0, 0.0
            support = start(frames[i], left[i], right[i], given[i], rows, p, t, work, room, x, P)
            if support > 0:
                seen_left, seen_right = True, True
                status = LOCKED if support >= t.lock_rows else TENTATIVE
                for side in range(2):
                    found, expected = tally(work, side)
                    new.share[i, side] = found / max(expected, 1)
                    new.found[i, side] = found / max(expected, 1)
        else:
            age += 1
            phase = predict(x, P, phase, speed[i] * t.step_s, t)
            before[:] = x
            good = invert(P, work.factor, work.prior)
            predict_spread(x, P, phase, rows, p, t, work)
            noise = pixel_noise(frames[i], rows, work)
            if good:
                gather(frames[i], rows, t, noise, work)
                if abs(x[OFFSET]) > 0.5 * x[WIDTH]:
                    side = LEFT if x[OFFSET] > 0.0 else RIGHT
                    share = share_of_paint(OUTER_LEFT if side == LEFT else OUTER_RIGHT, work)
                    if share > t.neighbour_share:
                        shift = 1 if side == LEFT else -1
                        shift_lane(x, P, shift, t)
                        new.share[i, 1 - side] = old.share[i, side]
                        new.share[i, side] = share
                        before[:] = x
                        good = invert(P, work.factor, work.prior)
                        predict_spread(x, P, phase, rows, p, t, work)
                        gather(frames[i], rows, t, noise, work)
                good = good and fit(x, phase, before, rows, p, t, 1.0, t.iterations, work)
            if good:
                found_left, expected_left = tally(work, LEFT)
                found_right, expected_right = tally(work, RIGHT)
                seen_left = side_seen(found_left, expected_left, t)
                seen_right = side_seen(found_right, expected_right, t)
                good = plausible(x, t)
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
                    new.share[i, side] = usual + (0.3 if share > usual else 0.02) * (share - usual)
                if status == TENTATIVE and seen_left and seen_right and age >= t.confirm_frames:
                    status = LOCKED
                if misses > (t.patience_frames if status == LOCKED else t.confirm_frames):
                    status = SEARCHING
            else:
                seen_left, seen_right = False, False
                x[:] = before
                new.found[i, :] = 0.0
                misses += 1
                if status == TENTATIVE or misses > t.patience_frames or not plausible(x, t):
                    status = SEARCHING
        seen_m = farthest_found(rows, x, p, work) if seen_left or seen_right else 0.0
        if status != SEARCHING and second_look(status, age, misses):
            support = support_of(work) if seen_left or seen_right else 0
            fresh = start(frames[i], left[i], right[i], False, rows, p, t, work, room, room.x, room.P)
            if fresh > 1.3 * support + 4:
                x[:], P[:, :], phase = room.x, room.P, 0.0
                misses, seen_left, seen_right = 0, True, True
                if fresh >= t.lock_rows:
                    status = LOCKED
        one_sided = 0 if seen_left and seen_right else old.one_sided[i] + 1
        if one_sided > t.one_sided_frames:
            status = SEARCHING
        new.one_sided[i] = one_sided if status != SEARCHING else 0
        new.phase[i], new.status[i], new.misses[i], new.age[i] = phase, status, misses, age
        if status == SEARCHING:
            new.found[i, :] = 0.0
            new.share[i, :] = 0.0
            x[:] = 0.0
            P[:, :] = 0.0
        new.reach_m[i] = max(seen_m, 0.9 * old.reach_m[i]) if status != SEARCHING else 0.0
        trace(x, phase, work.node)
        _report(i, x, phase, status, seen_left, seen_right, shift, p, t, work.node, new, out)


@kernel
def _report(i, x, phase, status, seen_left, seen_right, shift, p, t, node, new, out):  # type: ignore[no-untyped-def]
    locked = status == LOCKED
    out.locked[i] = locked
    out.left_border_seen[i] = seen_left and locked
    out.right_border_seen[i] = seen_right and locked
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
    # the secant over the 2 s ahead of a vehicle, which is what the prediction drives on
    out.curvature_rate_1pm2[i] = (curvature_at(x, phase, 2.0 * station) - curvature_at(x, phase, 0.0)) / (
        2.0 * max(station, 1.0)
    )
    out.lane_width_m[i] = x[WIDTH]
    out.preview_offset_m[i] = left
    out.preview_heading_rad[i] = direction


@kernel
def columns_kernel(x, phase, status, rows, p, furthest, out):  # type: ignore[no-untyped-def]
    """out (n, 2, rows): the column of both borders at each row; NaN where they are not seen or unlocked."""
    # further nodes than the fit uses: the curvature goes on as it is beyond the last knot
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


# reach of the model, for callers that check their settings against it
REACH_M = FURTHEST_M
