"""Finding the lane without prior knowledge, in one frame."""

from typing import NamedTuple

import numpy as np

from plugin.lane.acquire import (
    HALF_BINS,
    PER_SEGMENT,
    SEGMENTS,
    STARTS,
    initial_covariance,
    lane_start,
    line_within,
    parabola_as_candidates,
    ridge_points,
    vote,
)
from plugin.lane.cholesky import cholesky, invert, solve
from plugin.lane.evidence import most_support, of_usual_width, pixel_noise, plausible, side_seen, support_of
from plugin.lane.own_turn import expect, trust
from plugin.lane.refine_fit import (
    fit,
    gather,
    place_borders,
    predict_spread,
    tally,
)
from plugin.lane.rival import close
from plugin.lane.road_model import HEADING, LEFT, LINES, OFFSET, RIGHT, STATES, WIDTH
from sumo_net.arrays import Array
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_matrix, copy_vector


class Room(NamedTuple):
    """Work space of a start, without meaning between calls."""

    point: Array
    ridge: Array
    bin_of: Array
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
    nowhere: Array  # (STATES,) NaN
    kept: Array
    found: Array
    expected: Array


class Given(NamedTuple):
    """The published search's result for a vehicle."""

    there: bool | np.bool_
    left: Array  # (3,) a, b, c of the parabola
    right: Array


def room_for(rows: int) -> Room:
    """Work space for `rows` image rows."""
    return Room(
        np.zeros((rows * SEGMENTS * PER_SEGMENT, 2)),
        np.zeros((PER_SEGMENT, 2)),
        np.zeros(rows * SEGMENTS * PER_SEGMENT, np.int32),
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
        np.full(STATES, np.nan),
        np.zeros((STATES, STATES)),
        np.zeros((LINES, rows), np.bool_),
        np.zeros((LINES, rows), np.bool_),
    )


@kernel
def lean_to_lane(predicted, about, speed, yaw_rate, t, work, scratch):  # type: ignore[no-untyped-def]
    """Add to the prior a heading of `about` ± start_heading_std, since cars mostly drive along their lanes,
    and the vehicle's own yaw rate. False where the prior is not positive definite.
    """
    for i in range(STATES):
        scratch[i] = 0.0
        for j in range(STATES):
            scratch[i] += work.prior[i, j] * predicted[j]
    sure = 1.0 / (t.start_heading_std * t.start_heading_std)
    work.prior[HEADING, HEADING] += sure
    scratch[HEADING] += sure * about
    expect(work.prior, scratch, speed, yaw_rate, t.yaw_rate_std)
    if not cholesky(work.prior, work.factor, 0.0):
        return False
    solve(work.factor, scratch)
    copy_vector(scratch, predicted)
    return True


@kernel
def start(frame, given, about, least, followed, rows, p, t, work, room, x, P):  # type: ignore[no-untyped-def]
    """Find the lane without prior knowledge into x, P. Returns the rows that support it, 0 for no lane.

    least: lanes with no more supporting rows than this count as none.
    followed (STATES,): a confirmed lane, or NaN; where the best vote leads to it, no other is tried.

    given: the published search's result, Given. about: the expected heading, rad. The more a lane contradicts
    the vehicle's own yaw rate, the fewer its rows count.
    """
    image, speed, yaw_rate = frame.image, frame.speed, frame.yaw_rate
    best = least
    trial, predicted = room.trial, room.predicted
    lane_start(t, trial)
    place_borders(trial, 0.0, rows, p, t, work)
    noise = pixel_noise(image, rows, work)
    found = ridge_points(image, rows, p, t, noise, work, room.ridge, room.point)
    vote(room.point, found, about, t, room.bin_of, room.bins, room.smooth, room.starts, room.score)
    for attempt in range(STARTS + 1):
        if attempt == STARTS:
            if not given.there:
                continue
            lane_start(t, trial)
            copy_vector(trial, predicted)
            initial_covariance(P, t, 1.0, 0.05, t.lane_width_std_m, 2e-3)
            if not invert(P, work.factor, work.prior):
                continue
            predict_spread(trial, P, 0.0, rows, p, t, work)
            parabola_as_candidates(given.left, given.right, rows, work)
            if not fit(trial, 0.0, predicted, rows, p, t, 1.0, np.int64(3), work):
                continue
        else:
            if room.score[attempt] <= 0.0:
                continue
            copy_vector(room.starts[attempt], trial)
        if not plausible(trial, speed, t):
            continue
        copy_vector(trial, predicted)
        predicted[WIDTH] = 0.5 * (predicted[WIDTH] + t.lane_width_m)
        loose = 1.0 if attempt < STARTS else 2.0
        initial_covariance(P, t, 0.15 * loose, 0.008 * loose, 0.3, 8e-4 * loose)
        if not invert(P, work.factor, work.prior):
            continue
        predict_spread(trial, P, 0.0, rows, p, t, work)
        if not lean_to_lane(predicted, about, speed, yaw_rate, t, work, room.x):
            continue
        noise = pixel_noise(image, rows, work)
        gather(image, rows, t, noise, work)
        if not fit(trial, 0.0, predicted, rows, p, t, 1.0, np.int64(6), work):
            continue
        if attempt == 0 and close(trial, followed, t):
            room.score[1:] = 0.0
        # a second fit around the first result, with its covariance
        if not invert(work.information, work.factor, room.covariance):
            continue
        predict_spread(trial, room.covariance, 0.0, rows, p, t, work)
        gather(image, rows, t, noise, work)
        if most_support(work) <= best:
            continue
        if not fit(trial, 0.0, predicted, rows, p, t, 1.0, np.int64(5), work):
            continue
        found_left, expected_left = tally(work, LEFT)
        found_right, expected_right = tally(work, RIGHT)
        if not (side_seen(found_left, expected_left, t) and side_seen(found_right, expected_right, t)):
            continue
        if not plausible(trial, speed, t) or abs(trial[OFFSET]) > 0.5 * trial[WIDTH] + 0.3:
            continue
        support = int(support_of(trial, t, work) * trust(trial, 0.0, speed, yaw_rate, t.usual_turn))
        if not of_usual_width(trial, t):  # it may be two lanes
            support -= int(t.line_within * line_within(trial, room.point, found, room.bins))
        if support > best and invert(work.information, work.factor, room.covariance):
            best = support
            copy_vector(trial, room.chosen)
            copy_matrix(room.covariance, room.kept)
            copy_matrix(work.found, room.found)
            copy_matrix(work.expected, room.expected)
    if best == least:
        return 0
    copy_vector(room.chosen, x)
    copy_matrix(room.kept, P)
    copy_matrix(room.found, work.found)
    copy_matrix(room.expected, work.expected)
    return best
