"""Robust information update of the road model by the marking candidates of one frame.

Each row and border has up to CANDIDATES ridges. A candidate's weight is its probability, against the others
and against 'none of them is the border', under the current model (expectation step); the state is the
Gauss-Newton minimum of the weighted residuals and the prediction (maximisation step). The association width
shrinks from iteration to iteration. Information form: Λ = P⁻¹ + Σ w Jᵀ J / σ².
"""

import math
from typing import NamedTuple

import numpy as np

from plugin.lane.body import body_ahead
from plugin.lane.cholesky import cholesky, solve
from plugin.lane.hidden import BODIES, COLUMNS, is_hidden, without_hidden
from plugin.lane.ridge import BUFFER_PX, candidates
from plugin.lane.road_model import (
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
    SEEN,
    STATES,
    WIDTH,
    bases,
    border_columns,
    ground_of_rows,
    row_ground,
    sway,
    trace,
)
from sumo_net.arrays import Array
from sumo_net.compile import kernel

CANDIDATES = 3
MARGIN_PX = 5.0  # no ridge can be detected closer to the image's sides


class Work(NamedTuple):
    """Work space of one vehicle at a time."""

    node: Array  # (NODES, 5)
    ground: Array  # (rows, 4)
    border: Array  # (LINES, rows, 6)
    first: Array  # (KNOTS, KNOTS)
    area: Array
    ridge: Array  # (LINES, rows, CANDIDATES, 2) centre, strength
    ridges: Array  # (LINES, rows) int64 number of ridges
    expected: Array  # (LINES, rows) bool: a marking there would be visible
    spread: Array  # (rows,) standard deviation of the predicted borders, columns
    aside: Array  # (LINES,) m², further variance of a line's lateral position
    found: Array  # (LINES, rows) bool: a marking was found there
    sums: Array
    response: Array
    prior: Array  # (STATES, STATES) information
    information: Array  # (STATES, STATES)
    factor: Array  # (STATES, STATES)
    gradient: Array  # (STATES,)
    J: Array  # (STATES,)
    before: Array  # (STATES,) state before the frame
    along: Array  # (STATES,)
    hidden: Array  # (BODIES, COLUMNS) of `plugin.lane.hidden`


def workspace(rows: int) -> Work:
    """Work for `rows` image rows."""
    return Work(
        np.zeros((NODES, 5)),
        np.zeros((rows, 4)),
        np.zeros((LINES, rows, 6)),
        np.zeros((KNOTS, KNOTS)),
        np.zeros((KNOTS, KNOTS)),
        np.zeros((LINES, rows, CANDIDATES, 2)),
        np.zeros((LINES, rows), np.int64),
        np.zeros((LINES, rows), np.bool_),
        np.zeros(rows),
        np.zeros(LINES),
        np.zeros((LINES, rows), np.bool_),
        np.zeros(BUFFER_PX + 1, np.int32),
        np.zeros(BUFFER_PX),
        np.zeros((STATES, STATES)),
        np.zeros((STATES, STATES)),
        np.zeros((STATES, STATES)),
        np.zeros(STATES),
        np.zeros(STATES),
        np.zeros(STATES),
        np.zeros(STATES),
        np.zeros((BODIES, COLUMNS)),
    )


@kernel
def place_borders(x, phase, rows, p, t, work):  # type: ignore[no-untyped-def]
    """Trace the centre line and all four lines of state x, into work."""
    trace(x, phase, work.node)
    ground_of_rows(rows, x[PITCH], p, work.ground)
    for side in range(LINES):
        border_columns(x, work.ground, work.node, p, side, t.range_m, work.border[side])


@kernel
def jacobian(phase, side, r, p, work):  # type: ignore[no-untyped-def]
    """work.J = d column / d state of border `side` at row r; returns how many of its entries are set."""
    J = work.J
    column, scale, slope = work.border[side, r, 0], work.border[side, r, 1], work.border[side, r, 2]
    station = work.border[side, r, 3]
    slant = scale / max(work.border[side, r, 4], 0.3)
    J[OFFSET] = slant
    J[HEADING] = scale * (station + slope * (p.center_x - column) / scale)
    J[WIDTH] = -0.5 * slant if side in (LEFT, OUTER_LEFT) else 0.5 * slant
    J[NEXT_LEFT] = -slant if side == OUTER_LEFT else 0.0
    J[NEXT_RIGHT] = slant if side == OUTER_RIGHT else 0.0
    J[PITCH] = work.border[side, r, 5]
    seen = KNOT + sway(phase, work.first, work.area, station, J[KNOT:])
    for j in range(KNOT, seen):
        J[j] *= -slant
    return seen


@kernel
def predict_spread(x, P, phase, rows, p, t, work):  # type: ignore[no-untyped-def]
    """work.spread <- standard deviation of the borders' predicted columns; places the borders."""
    bases(phase, work.first, work.area)
    place_borders(x, phase, rows, p, t, work)
    work.aside[LEFT], work.aside[RIGHT] = 0.0, 0.0
    work.aside[OUTER_LEFT] = P[NEXT_LEFT, NEXT_LEFT]
    work.aside[OUTER_RIGHT] = P[NEXT_RIGHT, NEXT_RIGHT]
    last, at = 0.0, 0
    for r in range(rows.shape[0]):
        side = LEFT if not math.isnan(work.border[LEFT, r, 0]) else RIGHT
        edge = r % 4 == 0 or r == rows.shape[0] - 1
        if math.isnan(work.border[side, r, 0]) or not edge:
            work.spread[r] = last
            continue
        seen = jacobian(phase, side, r, p, work)
        variance = 0.0
        for i in range(seen):
            row = 0.0
            for j in range(seen):
                row += P[i, j] * work.J[j]
            variance += row * work.J[i]
        spread = math.sqrt(max(variance, 0.0))
        for k in range(at + 1, r):
            work.spread[k] = last + (spread - last) * (k - at) / (r - at)
        work.spread[r] = spread
        last, at = spread, r


@kernel
def line_spread(side, r, scale, work):  # type: ignore[no-untyped-def]
    """Standard deviation of the predicted column of a line at row r."""
    return math.sqrt(work.spread[r] * work.spread[r] + work.aside[side] * scale * scale)


@kernel
def gather(frame, rows, t, noise, work):  # type: ignore[no-untyped-def]
    """Collect marking candidates around all lines, within the reach that follows from work.spread.

    The lines are where predict_spread placed them.
    """
    height, width = frame.shape
    behind, first, last = body_ahead(frame, rows, work)
    for side in range(LINES):
        lean = 0.0
        for r in range(rows.shape[0]):
            column, scale = work.border[side, r, 0], work.border[side, r, 1]
            work.ridges[side, r] = 0
            work.found[side, r] = False
            visible = MARGIN_PX < column < width - 1 - MARGIN_PX  # False for NaN
            if visible:
                on_body = r >= behind and first <= column <= last
                visible = not on_body and not is_hidden(column, rows[r], work.hidden)
            work.expected[side, r] = visible
            furthest = t.furthest_aside_m * scale
            if not -furthest - t.reach_px < column < width + furthest + t.reach_px:
                continue
            spread = line_spread(side, r, scale, work)
            half = min(t.gate * spread + t.reach_m * scale, furthest) + t.reach_px
            # where the prediction is too uncertain to tell one line from the next, ridges would mislead
            sure = spread < t.unsure_m * scale + 1.0
            if sure and column > -half and column < width + half:
                if r + 1 < rows.shape[0] and not math.isnan(work.border[side, r + 1, 0]):
                    lean = (work.border[side, r + 1, 0] - column) / (rows[r + 1] - rows[r])
                work.ridges[side, r] = candidates(
                    frame,
                    height - 1 - int(rows[r]),
                    3 if abs(lean) < 5.0 else 1,
                    lean,
                    column,
                    half,
                    t.marking_width_m * scale,
                    noise,
                    t,
                    work.sums,
                    work.response,
                    work.ridge[side, r],
                )
                if r >= behind:
                    kept = 0
                    for c in range(work.ridges[side, r]):
                        if not first <= work.ridge[side, r, c, 0] <= last:
                            work.ridge[side, r, kept, 0] = work.ridge[side, r, c, 0]
                            work.ridge[side, r, kept, 1] = work.ridge[side, r, c, 1]
                            kept += 1
                    work.ridges[side, r] = kept
                work.ridges[side, r] = without_hidden(
                    work.ridge[side, r], work.ridges[side, r], rows[r], work.hidden
                )


@kernel
def fit(x, phase, predicted, rows, p, t, width, iterations, work):  # type: ignore[no-untyped-def]
    """Update x (start value in, estimate out) from `predicted` with information work.prior and candidates.

    The lines of the start value are where predict_spread placed them. width: initial association width in
    units of work.spread. The posterior information is left in work.information. Returns False on failure.
    """
    J, gradient, information = work.J, work.gradient, work.information
    for iteration in range(iterations):
        if iteration:
            place_borders(x, phase, rows, p, t, work)
        for i in range(STATES):
            g = 0.0
            for j in range(STATES):
                information[i, j] = work.prior[i, j]
                g += work.prior[i, j] * (predicted[j] - x[j])
            gradient[i] = g
        for side in range(LINES):
            for r in range(rows.shape[0]):
                work.found[side, r] = False
                column = work.border[side, r, 0]
                if work.ridges[side, r] == 0 or math.isnan(column):
                    continue
                scale = work.border[side, r, 1]
                inverse = 1.0 / (
                    width * line_spread(side, r, scale, work) + t.association_m * scale + t.association_px
                )
                total, moment = 0.0, 0.0
                for c in range(work.ridges[side, r]):
                    away = work.ridge[side, r, c, 0] - column
                    z = away * inverse
                    if z * z > 12.0:
                        continue
                    w = odds_of_paint(work.ridge[side, r, c, 1]) * math.exp(-0.5 * z * z)
                    total += w
                    moment += w * away
                if total <= 1e-4:
                    continue
                weight = total / (total + 1.0)
                work.found[side, r] = weight > 0.5
                away = moment / total
                noise_m = t.noise_m * scale
                # a ridge averages three neighbouring rows: where every row is read, each counts a third
                spacing = rows[r + 1] - rows[r] if r + 1 < rows.shape[0] else 1.0
                weight *= min(1.0, 0.34 * spacing) / (t.noise_px * t.noise_px + noise_m * noise_m)
                seen = jacobian(phase, side, r, p, work)
                for j in range(seen, STATES):
                    J[j] = 0.0
                for i in range(seen):
                    v = weight * J[i]
                    gradient[i] += v * away
                    row = information[i]
                    for j in range(SEEN):  # full rows vectorise; above the diagonal nothing is read
                        row[j] += v * J[j]
        if not cholesky(information, work.factor, 0.0):
            return False
        solve(work.factor, gradient)
        for i in range(STATES):
            x[i] += gradient[i]
        if not (abs(x[HEADING]) < 0.6 and abs(x[OFFSET]) < 20.0 and 1.0 < x[WIDTH] < 10.0):
            return False
        width *= t.narrowing
    for i in range(STATES):
        for j in range(i):
            information[j, i] = information[i, j]
    return True


@kernel
def odds_of_paint(strength):  # type: ignore[no-untyped-def]
    """Odds that a ridge is paint rather than texture, from its strength (response over the threshold)."""
    square = strength * strength
    return min(square * square * square, 60.0) / 6.0


@kernel
def tally(work, side):  # type: ignore[no-untyped-def]
    """(rows where the border was found, rows where it would be visible)."""
    found, expected = 0, 0
    for r in range(work.expected.shape[1]):
        if work.expected[side, r]:
            expected += 1
            if work.found[side, r]:
                found += 1
    return found, expected


@kernel
def nearest_found(side, rows, x, p, work):  # type: ignore[no-untyped-def]
    """How far ahead the nearest paint of a border was seen, in m; inf for none."""
    for r in range(rows.shape[0]):
        if work.found[side, r]:
            return row_ground(rows[r], x[PITCH], p)[0]
    return math.inf


@kernel
def farthest_found(rows, x, p, work):  # type: ignore[no-untyped-def]
    """Distance in m up to which paint was found on either border, without the two farthest rows."""
    count = 0
    for r in range(rows.shape[0] - 1, -1, -1):
        if work.found[LEFT, r] or work.found[RIGHT, r]:
            count += 1
            if count == 3:
                return row_ground(rows[r], x[PITCH], p)[0]
    return 0.0
