"""One frame of a lane that is being followed: predict it, collect candidates around it, fit, check.

Kernels here work on row i of the trackers' state `new`, in place.
"""

from typing import NamedTuple

import numpy as np

from plugin.lane.bends import seek_bends
from plugin.lane.cholesky import invert
from plugin.lane.evidence import (
    LEAST_JUDGED,
    of_usual_width,
    over,
    pixel_noise,
    plausible,
    share_of_paint,
    side_seen,
)
from plugin.lane.lane_motion import predict, shift_lane
from plugin.lane.own_turn import measure
from plugin.lane.refine_fit import fit, gather, predict_spread, tally
from plugin.lane.rival import LOOKS, carry
from plugin.lane.road_model import HEADING, LEFT, OFFSET, OUTER_LEFT, RIGHT, WIDTH
from sumo_net.arrays import Array
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_vector

SEARCHING, TENTATIVE, LOCKED = 0, 1, 2
RISE = 0.3  # part of the way that a share takes per frame to a greater one


class Frame(NamedTuple):
    """What the tracker gets from a vehicle in one step."""

    image: Array  # (240, 320) uint8
    speed: float  # m/s
    yaw_rate: float  # rad/s, NaN where unknown


class Seen(NamedTuple):
    """What a frame shows of the lane that is followed."""

    left: bool
    right: bool
    doubtful: bool  # less of it than usual
    shift: int  # +1 into the lane to the left, -1 to the right


@kernel
def follow(i, frame, old, new, rows, p, t, work, room):  # type: ignore[no-untyped-def]
    """Predict the lane of vehicle i and update it by a frame; returns what is Seen of it."""
    x, P, before = new.x[i], new.P[i], work.before
    new.age[i] += 1
    new.phase[i] = predict(x, P, new.phase[i], frame.speed * t.step_s, t)
    carry(new.rival[i], frame.speed * t.step_s)
    measure(x, P, new.phase[i], frame.speed, frame.yaw_rate, t.yaw_rate_std, work.along)
    good = _look_around(i, new, rows, p, t, work)
    noise = pixel_noise(frame.image, rows, work)
    shift = 0
    if good:
        gather(frame.image, rows, t, noise, work)
        _note_beside(new.beside[i], t, work)
        shift = _change_lanes(i, old, new, t)
        if shift != 0:
            good = _look_around(i, new, rows, p, t, work)
            gather(frame.image, rows, t, noise, work)
        good = good and fit(x, new.phase[i], before, rows, p, t, 1.0, t.iterations, work)
        if good and new.rival[i, LOOKS] == 0.0:  # not while a rival is compared with the lane as it is
            seek_bends(frame.image, x, P, new.phase[i], frame.speed, before, rows, p, t, noise, work, room)
    found_left, expected_left = tally(work, LEFT) if good else (0, LEAST_JUDGED)
    found_right, expected_right = tally(work, RIGHT) if good else (0, LEAST_JUDGED)
    left, right = side_seen(found_left, expected_left, t), side_seen(found_right, expected_right, t)
    if good and _believable(x, before, frame.speed, t) and invert(work.information, work.factor, P):
        _note_found(i, LEFT, found_left, expected_left, new)
        _note_found(i, RIGHT, found_right, expected_right, new)
        new.misses[i] = 0 if left or right else new.misses[i] + 1
        _confirm(i, left and right, new, t)
    else:
        left, right = False, False
        copy_vector(before, x)
        new.found[i, :] = 0.0
        new.misses[i] += 1
        lost = new.status[i] == TENTATIVE or new.misses[i] > t.patience_frames
        if lost or not plausible(x, frame.speed, t):
            new.status[i] = SEARCHING
    doubtful = _less_than_usual(i, LEFT, expected_left, old, new)
    doubtful = _less_than_usual(i, RIGHT, expected_right, old, new) or doubtful
    return Seen(left, right, doubtful, shift)


@kernel
def _look_around(i, new, rows, p, t, work):  # type: ignore[no-untyped-def]
    """Make the state the prediction of the frame: its information, and where it expects the lines."""
    copy_vector(new.x[i], work.before)
    good = invert(new.P[i], work.factor, work.prior)
    predict_spread(new.x[i], new.P[i], new.phase[i], rows, p, t, work)
    return good


@kernel
def _note_beside(beside, t, work):  # type: ignore[no-untyped-def]
    """Update the shares (2,) of rows where the outer lines of the lanes beside were seen lately."""
    for side in range(2):
        share = share_of_paint(side + OUTER_LEFT, work)
        if share >= 0.0:
            beside[side] += (RISE if share > beside[side] else 0.05) * (share - beside[side])


@kernel
def _change_lanes(i, old, new, t):  # type: ignore[no-untyped-def]
    """Follow the neighbouring lane once the vehicle is in it: +1 left, -1 right, 0 for no change."""
    x, share, beside, unseen_m = new.x[i], new.share[i], new.beside[i], new.unseen_m[i]
    if not abs(x[OFFSET]) > 0.5 * x[WIDTH]:
        return 0
    side = LEFT if x[OFFSET] > 0.0 else RIGHT
    if not (beside[side] > t.neighbour_share and over(side, x, t)):
        return 0
    shift = 1 if side == LEFT else -1
    shift_lane(x, new.P[i], shift, t)
    share[1 - side] = old.share[i, side]
    share[side] = beside[side]
    beside[1 - side] = max(old.share[i, 1 - side], 2.0 * t.neighbour_share)
    beside[side] = 0.0
    unseen_m[1 - side] = unseen_m[side]
    unseen_m[side] = np.inf
    return shift


@kernel
def _believable(x, before, speed, t):  # type: ignore[no-untyped-def]
    """Whether a fitted lane can be the one that was predicted."""
    near = abs(x[OFFSET] - before[OFFSET]) < t.jump_m and abs(x[HEADING] - before[HEADING]) < t.jump_rad
    return plausible(x, speed, t) and near


@kernel
def _note_found(i, side, found, expected, new):  # type: ignore[no-untyped-def]
    """Update the share of rows where a border was seen, and what it usually is."""
    share, usual = found / max(expected, 1), new.share[i, side]
    new.found[i, side] = share
    if expected >= LEAST_JUDGED:
        new.share[i, side] = usual + (RISE if share > usual else 0.02) * (share - usual)


@kernel
def _confirm(i, both_seen, new, t):  # type: ignore[no-untyped-def]
    """A tentative lane seen for long enough is locked; one not seen for too long is given up."""
    confirm = t.confirm_frames if of_usual_width(new.x[i], t) else t.odd_confirm_frames
    if new.status[i] == TENTATIVE and both_seen and new.age[i] >= confirm:
        new.status[i] = LOCKED
    if new.misses[i] > (t.patience_frames if new.status[i] == LOCKED else t.confirm_frames):
        new.status[i] = SEARCHING


@kernel
def _less_than_usual(i, side, expected, old, new):  # type: ignore[no-untyped-def]
    """Whether less of a border was found than usual, in this frame and the one before."""
    seen_lately = max(new.found[i, side], old.found[i, side])
    return expected >= LEAST_JUDGED and seen_lately < 0.6 * new.share[i, side]
