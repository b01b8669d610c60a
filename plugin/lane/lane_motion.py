"""Prediction of the road model's state over a step, and its change to a neighbouring lane."""

import math

from plugin.lane.road_model import (
    HEADING,
    KNOT,
    KNOTS,
    NEXT_LEFT,
    NEXT_RIGHT,
    OFFSET,
    PITCH,
    SPACING_M,
    STATES,
    TURN,
    WIDTH,
    curvature_at,
)
from sumo_net.compile import kernel


@kernel
def predict(x, P, phase, advance, t):  # type: ignore[no-untyped-def]
    """Predict state and covariance over a step in which the vehicle drove `advance` metres; returns phase.

    The centre of gravity moves along the heading and sideways with v_y = γ (l_r - c v²), the sideslip of a
    steady turn (single-track model). Without it, the heading would be wrong by the slip in every bend.
    """
    T = t.step_s
    keep = math.exp(-T / t.turn_time_s)
    speed = advance / T
    slip = t.rear_axle_m - t.rear_slip_s2pm * speed * speed  # v_y / γ
    drift = advance * T * 0.5 + T * slip
    x[OFFSET] += advance * (x[HEADING] + slip * curvature_at(x, phase, 0.5 * advance)) + drift * x[TURN]
    x[HEADING] += T * x[TURN]
    x[TURN] *= keep
    x[PITCH] *= t.pitch_keep
    for j in range(NEXT_LEFT, NEXT_RIGHT + 1):
        # neighbouring lanes are about as wide as this one
        x[j] = x[WIDTH] + t.next_keep * (x[j] - x[WIDTH])
        for k in range(STATES):
            P[j, k] *= t.next_keep
        for k in range(STATES):
            P[k, j] *= t.next_keep
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
    P[PITCH, PITCH] += t.pitch_std_rad * t.pitch_std_rad * (1.0 - t.pitch_keep * t.pitch_keep)
    for j in range(KNOT, KNOT + KNOTS):
        P[j, j] += t.knot_walk * t.knot_walk * advance
    return phase


@kernel
def _drop_knot(x, P, t):  # type: ignore[no-untyped-def]
    """Drop the first knot, which has fallen behind, renumber, and append one."""
    last = KNOT + KNOTS - 1
    for j in range(KNOT, last):
        x[j] = x[j + 1]
    for i in range(STATES):
        for j in range(KNOT, last):
            P[i, j] = P[i, j + 1]
    for j in range(KNOT, last):
        for i in range(STATES):
            P[j, i] = P[j + 1, i]
    extend(x, P, last, t)


@kernel
def continued(x, j, t):  # type: ignore[no-untyped-def]
    """Curvature at knot state j continued from the two before: part of the last change goes on, as in a
    clothoid, and the curvature decays, since every road becomes straight again.
    """
    return (t.bend_keep + t.bend_slope) * x[j - 1] - t.bend_slope * x[j - 2]


@kernel
def extend(x, P, j, t):  # type: ignore[no-untyped-def]
    """Set the knot state j to the continuation of those before, ± bend_std."""
    g1, g2 = t.bend_keep + t.bend_slope, -t.bend_slope
    x[j] = continued(x, j, t)
    for k in range(STATES):
        P[j, k] = g1 * P[j - 1, k] + g2 * P[j - 2, k]
    for i in range(STATES):
        P[i, j] = g1 * P[i, j - 1] + g2 * P[i, j - 2]
    P[j, j] = g1 * P[j, j - 1] + g2 * P[j, j - 2] + t.bend_std_1pm * t.bend_std_1pm


@kernel
def shift_lane(x, P, side, t):  # type: ignore[no-untyped-def]
    """Change the state to the neighbouring lane: +1 left, -1 right. All lines stay where they are.

    offset -= side (WIDTH + NEXT) / 2; the neighbour's width becomes the lane's, and the lane's that of the
    neighbour on the other side. The new neighbour is unknown.
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
