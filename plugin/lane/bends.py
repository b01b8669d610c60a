"""The road ahead is fitted anew where it bends more than roads do.

What is seen far ahead is small, and partly not paint: edges and lamps of vehicles that the radar does not
see. A line that followed such a thing for some frames counts as well known, since frames are treated as
independent, and keeps a wrong bend while it comes nearer. No single frame would outweigh the prior of how
roads bend. So where the curvature departs too far from its continuation, the road from there on is reset to
the prior and fitted to the present frame; the result is taken if it is more likely by this frame alone.
"""

import math

from plugin.lane.cholesky import invert
from plugin.lane.lane_motion import continued, extend
from plugin.lane.refine_fit import fit, gather, odds_of_paint, place_borders, predict_spread
from plugin.lane.road_model import KNOT, KNOTS, LINES
from sumo_net.compile import kernel
from sumo_net.copy_kernels import copy_matrix, copy_vector

FIRST = 2  # the first knot that is predicted from knots before it


@kernel
def odd_bend(x, t):  # type: ignore[no-untyped-def]
    """The first knot whose curvature departs too far from the continuation of those before; KNOTS: none."""
    for j in range(FIRST, KNOTS):
        if abs(x[KNOT + j] - continued(x, KNOT + j, t)) > t.gate * t.bend_std_1pm:
            return j
    return KNOTS


@kernel
def bend_std(speed, t):  # type: ignore[no-untyped-def]
    """Standard deviation of a knot's curvature about its continuation, on roads driven at this speed."""
    v = max(speed, t.bend_slow_mps)
    return max(t.bend_std_1pm, t.bend_std_mps2 / (v * v))


@kernel
def likelihood(x, phase, rows, p, bend, t, work):  # type: ignore[no-untyped-def]
    """Logarithm of the posterior of road x by the gathered ridges, up to a constant; bend: as `bend_std`."""
    place_borders(x, phase, rows, p, t, work)
    total = 0.0
    for side in range(LINES):
        for r in range(rows.shape[0]):
            column, scale = work.border[side, r, 0], work.border[side, r, 1]
            if work.ridges[side, r] == 0 or math.isnan(column):
                continue
            inverse = 1.0 / (t.association_m * scale + t.association_px)
            odds = 0.0
            for c in range(work.ridges[side, r]):
                z = (work.ridge[side, r, c, 0] - column) * inverse
                odds += odds_of_paint(work.ridge[side, r, c, 1]) * math.exp(-0.5 * z * z)
            spacing = rows[r + 1] - rows[r] if r + 1 < rows.shape[0] else 1.0
            total += min(1.0, 0.34 * spacing) * math.log(1.0 + odds)
    for j in range(FIRST, KNOTS):
        off = (x[KNOT + j] - continued(x, KNOT + j, t)) / bend
        total -= 0.5 * off * off
    return total


@kernel
def seek_bends(frame, x, P, phase, speed, before, rows, p, t, noise, work, room):  # type: ignore[no-untyped-def]
    """Fit the road anew from `odd_bend` of x on; put it into x if it is more likely and bends less oddly.

    P is the prediction's covariance, `before` its state. The better fit's results are left in work.
    """
    first = odd_bend(x, t)
    if first == KNOTS:
        return
    bend = bend_std(speed, t)
    followed = likelihood(x, phase, rows, p, bend, t, work)
    copy_matrix(work.information, room.kept)
    copy_matrix(work.found, room.found)
    copy_matrix(work.expected, room.expected)
    trial, predicted = room.trial, room.predicted
    copy_vector(before, predicted)
    copy_matrix(P, room.covariance)
    for j in range(first, KNOTS):
        extend(predicted, room.covariance, KNOT + j, t)
    copy_vector(predicted, trial)
    if invert(room.covariance, work.factor, work.prior):
        predict_spread(trial, room.covariance, phase, rows, p, t, work)
        gather(frame, rows, t, noise, work)
        if fit(trial, phase, predicted, rows, p, t, 1.0, t.iterations, work) and (
            odd_bend(trial, t) > first and likelihood(trial, phase, rows, p, bend, t, work) > followed
        ):
            copy_vector(trial, x)
            return
    copy_matrix(room.kept, work.information)
    copy_matrix(room.found, work.found)
    copy_matrix(room.expected, work.expected)
