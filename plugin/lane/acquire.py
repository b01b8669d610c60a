"""Starting the road model: from the published search's parabolas, and from a vote of all ridges.

The vote is an alternative for frames where shadows or hidden paint mislead the search: every ridge nearer
than `NEAR_M` votes, for each heading and curvature of a grid, for a lateral position; the best pair of
positions a lane width apart with the vehicle between them wins. If their distance is an unusual lane width,
votes for a line between them count against the pair. The start whose fit finds more paint is taken.
"""

import math

import numpy as np

from plugin.lane.evidence import width_odds
from plugin.lane.hidden import without_hidden
from plugin.lane.ridge import candidates
from plugin.lane.road_model import (
    HEADING,
    KNOT,
    KNOTS,
    LEFT,
    LINES,
    NEXT_LEFT,
    NEXT_RIGHT,
    OFFSET,
    OUTER_LEFT,
    PITCH,
    SPACING_M,
    STATES,
    TURN,
    WIDTH,
    row_ground,
)
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_vector

NEAR_M = 60.0
MIDDLE_M = 28.0
SEGMENTS, PER_SEGMENT = 5, 3
BIN_M, HALF_BINS = 0.15, 60
WIDEST_M = 2 * HALF_BINS * BIN_M  # widest lane whose borders fall into the bins
HEADINGS, HEADING_STEP = 19, 0.008
CURVATURES, CURVATURE_STEP = 17, 6.0e-4
STARTS = 3
CLEAR_M = 0.75  # closer to a border, a line may be the other one of a pair


@kernel
def initial_covariance(P, t, lateral_std, direction_std, width_std, curvature_std):  # type: ignore[no-untyped-def]
    """P of a start: an arc with independent errors of position and direction at MIDDLE_M and of curvature.

    Along the road, the curvature is a random walk about the arc's.
    """
    P[:, :] = 0.0
    for i in range(STATES):
        for j in range(STATES):
            # offset = -(y - M direction + K M² / 2), heading = -(direction - K M)
            lateral = (i == OFFSET) * (j == OFFSET)
            d_i = MIDDLE_M * (i == OFFSET) - (i == HEADING)
            d_j = MIDDLE_M * (j == OFFSET) - (j == HEADING)
            k_i = -0.5 * MIDDLE_M**2 * (i == OFFSET) + MIDDLE_M * (i == HEADING) + (KNOT <= i < KNOT + KNOTS)
            k_j = -0.5 * MIDDLE_M**2 * (j == OFFSET) + MIDDLE_M * (j == HEADING) + (KNOT <= j < KNOT + KNOTS)
            P[i, j] = lateral * lateral_std**2 + d_i * d_j * direction_std**2 + k_i * k_j * curvature_std**2
    P[WIDTH, WIDTH] = width_std * width_std
    P[NEXT_LEFT, NEXT_LEFT] = t.next_std * t.next_std
    P[NEXT_RIGHT, NEXT_RIGHT] = t.next_std * t.next_std
    P[PITCH, PITCH] = t.pitch_std_rad * t.pitch_std_rad
    P[TURN, TURN] = t.turn_std * t.turn_std
    pivot = int(MIDDLE_M / SPACING_M)
    for i in range(KNOTS):
        for j in range(KNOTS):
            if (i > pivot) == (j > pivot):
                P[KNOT + i, KNOT + j] += min(abs(i - pivot), abs(j - pivot)) * t.bend_std_1pm * t.bend_std_1pm
    for j in range(KNOTS):
        P[KNOT + j, KNOT + j] += 1e-10


@kernel
def parabola_as_candidates(left, right, rows, work):  # type: ignore[no-untyped-def]
    """Use the columns of the search's borders (a, b, c) as ridges."""
    for side in range(OUTER_LEFT, LINES):
        work.ridges[side, :] = 0
    for side in range(OUTER_LEFT):
        a, b, c = (left[0], left[1], left[2]) if side == LEFT else (right[0], right[1], right[2])
        for r in range(rows.shape[0]):
            y = rows[r]
            work.ridges[side, r] = 1
            work.expected[side, r] = True
            work.ridge[side, r, 0, 0] = (a * y + b) * y + c
            work.ridge[side, r, 0, 1] = 1e6


@kernel
def ridge_points(frame, rows, p, t, noise, work, ridge, point):  # type: ignore[no-untyped-def]
    """All ridges on the road nearer than NEAR_M, into point (M, 2): forward, left; returns their number."""
    height, width = frame.shape
    vanishing_x = p.center_x + p.focal * p.sin_yaw / p.cos_yaw
    vanishing_y = p.center_y + p.focal_y * p.sin_pitch / p.cos_pitch
    half = 0.5 * width / SEGMENTS
    found = 0
    for r in range(rows.shape[0]):
        ahead, depth, _, _ = row_ground(rows[r], 0.0, p)
        if ahead > NEAR_M:
            break
        scale = p.focal / depth
        for segment in range(SEGMENTS):
            column = (2 * segment + 1) * half - 0.5
            count = candidates(
                frame,
                height - 1 - int(rows[r]),
                np.int64(3),  # a literal 3 would make another compiled variant
                (vanishing_x - column) / (vanishing_y - rows[r]),
                column,
                half,
                t.marking_width_m * scale,
                1.2 * noise,
                t,
                work.sums,
                work.response,
                ridge,
            )
            count = without_hidden(ridge, count, rows[r], work.hidden)
            for c in range(count):
                aside = (p.center_x - ridge[c, 0]) / scale
                point[found, 0] = p.cos_yaw * ahead - p.sin_yaw * aside + p.forward
                point[found, 1] = p.sin_yaw * ahead + p.cos_yaw * aside + p.left
                found += 1
    return found


@kernel
def together(left, right):  # type: ignore[no-untyped-def]
    """The votes of two borders as one number, dominated by the weaker one."""
    return min(left, 4.0 * right) + min(right, 4.0 * left)


@kernel
def vote(point, found, about, t, bin_of, bins, smooth, starts, score):  # type: ignore[no-untyped-def]
    """Put the arcs with most votes, each of another curvature, into starts (STARTS, STATES), best first.

    Headings are tried around `about`. Arcs are parametrised by their direction at MIDDLE_M, where heading and
    curvature are nearly uncorrelated. Their votes go into score (STARTS,); 0: unused.
    """
    count = 2 * HALF_BINS + 1
    narrow = math.floor(t.min_width_m / BIN_M)
    wide = math.ceil(t.max_width_m / BIN_M)
    clear = math.ceil(CLEAR_M / BIN_M)
    usual = math.ceil(t.lane_width_m / BIN_M)  # from which on wider lanes are less likely
    odds = np.zeros(wide + 1)
    for b in range(wide + 1):
        odds[b] = width_odds(b * BIN_M, t)
    trial = np.zeros(STATES)
    starts[:, :] = 0.0
    score[:] = 0.0
    for k in range(CURVATURES):
        curvature = (k - CURVATURES // 2) * CURVATURE_STEP
        best = 0.0
        for h in range(HEADINGS):
            heading = about + (h - HEADINGS // 2) * HEADING_STEP
            direction = curvature * MIDDLE_M - heading
            # lateral position of the arc abreast of the vehicle, relative to that at MIDDLE_M
            back = -MIDDLE_M * (direction - 0.5 * curvature * MIDDLE_M)
            middle = HALF_BINS - math.floor(back / BIN_M + 0.5)
            # bins that can be a border of a lane around the vehicle, and one more each side
            first, last = max(middle - wide - 1, 0), min(middle + wide + 2, count)
            for b in range(first, last):
                bins[b] = 0.0
            for m in range(found):  # a loop of its own, which vectorises
                away = point[m, 0] - MIDDLE_M
                left = point[m, 1] - away * (direction + 0.5 * curvature * away)
                bin_of[m] = np.int32(math.floor(left / BIN_M + 0.5))
            for m in range(found):
                b = bin_of[m] + HALF_BINS
                if first <= b < last:
                    bins[b] += 1.0
            smooth[first], smooth[last - 1] = 0.0, 0.0
            for b in range(first + 1, last - 1):
                smooth[b] = bins[b] + 0.5 * bins[b - 1] + 0.5 * bins[b + 1]
            most = 0.0  # of a right border
            for c in range(max(0, middle - wide), min(middle + 1, count)):
                most = max(most, smooth[c])
            for b in range(max(middle, 0), min(middle + wide, count)):
                if smooth[b] < 3.0 or together(smooth[b], most) <= best:
                    continue
                nearest = min(b - narrow, middle)
                if b - nearest > usual and 5.0 * smooth[b] * odds[b - nearest] <= best:
                    continue
                within = 0.0  # votes of the best line between the two, which may be two lanes
                for inner in range(nearest + clear + 1, b - clear + 1):
                    within = max(within, smooth[inner])
                for c in range(nearest, max(0, b - wide) - 1, -1):
                    if c + clear <= b - clear:
                        within = max(within, smooth[c + clear])
                    if b - c > usual and 5.0 * smooth[b] * odds[b - c] <= best:
                        break  # wider ones cannot win
                    if smooth[c] < 3.0:
                        continue
                    votes = together(smooth[b], smooth[c])
                    if odds[b - c] < t.usual_width:
                        votes -= t.line_within * within
                    votes *= odds[b - c]
                    if votes > best:
                        width = (b - c) * BIN_M
                        best = votes
                        trial[OFFSET] = -0.5 * (b + c - 2 * HALF_BINS) * BIN_M - back
                        trial[HEADING] = heading
                        trial[WIDTH] = width
                        trial[NEXT_LEFT] = width
                        trial[NEXT_RIGHT] = width
                        trial[KNOT : KNOT + KNOTS] = curvature
        # neighbouring curvatures share a slot: they are the same lane
        place = STARTS
        for n in range(STARTS):
            if score[n] > 0.0 and abs(starts[n, KNOT] - curvature) < 1.5 * CURVATURE_STEP:
                place = n
        if place < STARTS:
            if best <= score[place]:
                continue
        else:
            place = STARTS - 1
            if best <= score[place]:
                continue
        while place > 0 and best > score[place - 1]:
            score[place] = score[place - 1]
            copy_vector(starts[place - 1], starts[place])
            place -= 1
        score[place] = best
        copy_vector(trial, starts[place])


@kernel
def line_within(x, point, found, bins):  # type: ignore[no-untyped-def]
    """Number of ridges on the best line parallel to the lane x between its borders, not close to either."""
    bins[:] = 0.0
    reach = 0.5 * x[WIDTH] - CLEAR_M
    for m in range(found):
        ahead = point[m, 0]
        left = point[m, 1] + x[OFFSET] + ahead * (x[HEADING] - 0.5 * x[KNOT + 1] * ahead)
        if abs(left) < reach:
            bins[math.floor(left / BIN_M + 0.5) + HALF_BINS] += 1.0
    most = 0.0
    for b in range(1, bins.shape[0] - 1):
        most = max(most, bins[b] + 0.5 * (bins[b - 1] + bins[b + 1]))
    return most


@kernel
def lane_start(t, x):  # type: ignore[no-untyped-def]
    """Set x to a straight lane of usual width with the vehicle in its middle."""
    x[:] = 0.0
    x[WIDTH] = t.lane_width_m
    x[NEXT_LEFT] = t.lane_width_m
    x[NEXT_RIGHT] = t.lane_width_m
