"""The ground-plane road model of the default mode, and the position of its borders in the image.

The lane's centre line starts abreast of the centre of gravity. Its curvature is linear between knots that are
fixed on the ground while the vehicle drives over them: what was seen 40 m ahead is still known when it is
under the wheels, where a narrow camera sees nothing. State vector x, (STATES,):

    OFFSET   m     centre of gravity left of the lane centre
    HEADING  rad   vehicle heading minus lane heading at the centre of gravity
    WIDTH    m     lane width; the borders are at ± WIDTH / 2
    PITCH    rad   correction to the camera's pitch, downwards positive
    NEXT_LEFT, NEXT_RIGHT   m   widths of the neighbouring lanes, whose outer lines show the road's course too
    KNOT...  1/m   curvature at stations -phase + j SPACING_M, j = 0 ... KNOTS - 1
    TURN     rad/s vehicle's yaw rate minus speed times curvature (not visible in a single image)

The centre line is integrated without small-angle or parabola approximation, so that a curve of 250 m radius
and a clothoid that begins within the view are both represented.
"""

import math

import numpy as np

from camera_synth.camera import HEIGHT_PX
from sumo_net.compile import kernel

KNOTS = 9
SPACING_M = 15.0
OFFSET, HEADING, WIDTH, PITCH, NEXT_LEFT, NEXT_RIGHT, KNOT = 0, 1, 2, 3, 4, 5, 6
TURN = KNOT + KNOTS
STATES = TURN + 1
SEEN = TURN  # number of states that an image depends on; they come first

PER_KNOT = 4  # nodes of the centre line between two knots
NODE_M = SPACING_M / PER_KNOT
NODES = PER_KNOT * (KNOTS - 1)
FURTHEST_M = SPACING_M * (KNOTS - 2)  # covered by knots at every phase

LEFT, RIGHT, OUTER_LEFT, OUTER_RIGHT = 0, 1, 2, 3  # borders, and outer lines of the neighbouring lanes
LINES = 4


@kernel
def curvature_at(x, phase, station):  # type: ignore[no-untyped-def]
    """Curvature of the model in 1/m, constant before the first knot and beyond the last."""
    along = (station + phase) / SPACING_M
    if along <= 0.0:
        return x[KNOT]
    j = int(along)
    if j >= KNOTS - 1:
        return x[KNOT + KNOTS - 1]
    part = along - j
    return (1.0 - part) * x[KNOT + j] + part * x[KNOT + j + 1]


@kernel
def trace(x, phase, node):  # type: ignore[no-untyped-def]
    """Integrate the centre line into node (NODES, 5): station, forward, left, sin, cos of its direction.

    Vehicle frame. Node 0 is abreast of the centre of gravity, the others are at the knots and between them.
    """
    direction = -x[HEADING]
    sine, cosine = math.sin(direction), math.cos(direction)
    forward, left = x[OFFSET] * sine, -x[OFFSET] * cosine
    station, curvature = 0.0, curvature_at(x, phase, 0.0)
    within = phase - NODE_M * math.floor(phase / NODE_M)
    node[0, 0], node[0, 1], node[0, 2], node[0, 3], node[0, 4] = station, forward, left, sine, cosine
    for i in range(1, node.shape[0]):
        s = i * NODE_M - within
        k = curvature_at(x, phase, s)
        ds = s - station
        turned = 0.5 * (curvature + k) * ds
        direction += turned
        # sine and cosine of the new direction by the angle-sum rule; the turn is small
        square = turned * turned
        st = turned * (1.0 - square / 6.0)
        ct = 1.0 - 0.5 * square * (1.0 - square / 12.0)
        sine_new, cosine_new = sine * ct + cosine * st, cosine * ct - sine * st
        # trapezoidal rule with the derivative correction at the ends: error of fifth order in ds
        part = ds * ds / 12.0
        forward += 0.5 * ds * (cosine + cosine_new) + part * (sine_new * k - sine * curvature)
        left += 0.5 * ds * (sine + sine_new) - part * (cosine_new * k - cosine * curvature)
        station, curvature, sine, cosine = s, k, sine_new, cosine_new
        node[i, 0], node[i, 1], node[i, 2], node[i, 3], node[i, 4] = station, forward, left, sine, cosine


@kernel
def row_ground(y, pitch, p):  # type: ignore[no-untyped-def]
    """(ahead, depth, d ahead / d pitch, d depth / d pitch) of the road at image row y; ahead: metres from the
    camera along its own azimuth, inf above the horizon.
    """
    sine = p.sin_pitch + pitch * p.cos_pitch
    cosine = p.cos_pitch - pitch * p.sin_pitch
    t = (y - p.center_y) / p.focal_y
    fall = sine - t * cosine
    if fall <= 1e-6:
        return math.inf, math.inf, 0.0, 0.0
    ahead = p.height * (cosine + t * sine) / fall
    depth = cosine * ahead + sine * p.height
    d_ahead = -(ahead * ahead + p.height * p.height) / p.height
    return ahead, depth, d_ahead, cosine * d_ahead - sine * ahead + cosine * p.height


@kernel
def ground_of_rows(rows, pitch, p, ground):  # type: ignore[no-untyped-def]
    """ground (rows, 4) <- row_ground of all rows."""
    for r in range(rows.shape[0]):
        ground[r, 0], ground[r, 1], ground[r, 2], ground[r, 3] = row_ground(rows[r], pitch, p)


@kernel
def border_columns(x, ground, node, p, side, furthest, out):  # type: ignore[no-untyped-def]
    """Where one line (LEFT … OUTER_RIGHT) crosses image rows, given by ground_of_rows with y ascending.

    out (rows, 6): column, pixels per metre across, slope of the border against the camera's axis, station,
    cosine of the lane's direction, d column / d pitch. Rows that the line does not cross have column NaN.
    """
    d = 0.5 * x[WIDTH] if side in (LEFT, OUTER_LEFT) else -0.5 * x[WIDTH]
    if side == OUTER_LEFT:
        d += x[NEXT_LEFT]
    elif side == OUTER_RIGHT:
        d -= x[NEXT_RIGHT]
    i = 0
    ahead_0, aside_0, slope_0 = _node_seen(node, i, d, p)
    i = 1
    ahead_1, aside_1, slope_1 = _node_seen(node, i, d, p)
    for r in range(ground.shape[0]):
        ahead, depth = ground[r, 0], ground[r, 1]
        out[r, 0] = math.nan
        if ahead > furthest:
            continue
        while ahead > ahead_1 and i + 1 < node.shape[0]:
            ahead_0, aside_0, slope_0 = ahead_1, aside_1, slope_1
            i += 1
            ahead_1, aside_1, slope_1 = _node_seen(node, i, d, p)
        length = ahead_1 - ahead_0
        if ahead > ahead_1 or ahead < ahead_0 or length <= 0.0:
            continue
        u = (ahead - ahead_0) / length
        v = 1.0 - u
        aside = (
            v * v * (1.0 + 2.0 * u) * aside_0
            + u * u * (1.0 + 2.0 * v) * aside_1
            + u * v * length * (v * slope_0 - u * slope_1)
        )
        slope = v * slope_0 + u * slope_1
        scale = p.focal / depth
        out[r, 0] = p.center_x - scale * aside
        out[r, 1] = scale
        out[r, 2] = slope
        out[r, 3] = v * node[i - 1, 0] + u * node[i, 0]
        out[r, 4] = v * node[i - 1, 4] + u * node[i, 4]
        out[r, 5] = -scale * (slope * ground[r, 2] - aside * ground[r, 3] / depth)


@kernel
def _node_seen(node, i, d, p):  # type: ignore[no-untyped-def]
    """(ahead, aside, slope) in the camera's direction of the line d left of the centre line at node i."""
    f0 = node[i, 1] - d * node[i, 3] - p.forward
    l0 = node[i, 2] + d * node[i, 4] - p.left
    across = p.cos_yaw * node[i, 3] - p.sin_yaw * node[i, 4]
    along = p.cos_yaw * node[i, 4] + p.sin_yaw * node[i, 3]
    return p.cos_yaw * f0 + p.sin_yaw * l0, -p.sin_yaw * f0 + p.cos_yaw * l0, across / max(along, 0.2)


@kernel
def bases(phase, first, area):  # type: ignore[no-untyped-def]
    """Moments of the knots' hat functions up to every knot, from which `sway` continues.

    first (KNOTS, KNOTS): ∫ (S_i − σ) B_j dσ from 0 to S_i; area: ∫ B_j dσ. S_0 = 0, S_i = i SPACING − phase.
    """
    first[:, :] = 0.0
    area[:, :] = 0.0
    for i in range(1, KNOTS):
        length = SPACING_M if i > 1 else SPACING_M - phase
        start = 0.0 if i > 1 else phase / SPACING_M  # value of B_i where the segment begins
        for j in range(i):
            area[i, j] = area[i - 1, j]
            first[i, j] = first[i - 1, j] + area[i - 1, j] * length
        end = 1.0
        area[i, i] = 0.5 * length * (start + end)
        first[i, i] = length * length * (2.0 * start + end) / 6.0
        area[i, i - 1] += 0.5 * length * ((1.0 - start) + (1.0 - end))
        first[i, i - 1] += length * length * (2.0 * (1.0 - start) + (1.0 - end)) / 6.0


@kernel
def sway(phase, first, area, station, out):  # type: ignore[no-untyped-def]
    """out[j] = lateral displacement at `station` per unit curvature at knot j; returns how many j are set."""
    i = min(int((station + phase) / SPACING_M), KNOTS - 2)
    base = i * SPACING_M - phase
    start = 0.0
    if i == 0:
        start, base = phase / SPACING_M, 0.0
    length = station - base
    square = length * length
    end = start + length / SPACING_M
    for j in range(i + 1):
        out[j] = first[i, j] + area[i, j] * length
    out[i] += square * (2.0 * (1.0 - start) + (1.0 - end)) / 6.0
    out[i + 1] = first[i, i + 1] + area[i, i + 1] * length + square * (2.0 * start + end) / 6.0
    return i + 2


@kernel
def preview(x, node, distance):  # type: ignore[no-untyped-def]
    """(lane centre left of the vehicle's axis, lane heading minus vehicle heading, station) where the centre
    line is `distance` ahead of the centre of gravity.
    """
    i = 1
    while i + 1 < node.shape[0] and node[i, 1] < distance:
        i += 1
    u = (distance - node[i - 1, 1]) / max(node[i, 1] - node[i - 1, 1], 1e-3)
    tangent = node[i - 1, 3] / node[i - 1, 4] + u * (
        node[i, 3] / node[i, 4] - node[i - 1, 3] / node[i - 1, 4]
    )
    # cubic Hermite, as in border_columns
    v = 1.0 - u
    length = node[i, 1] - node[i - 1, 1]
    left = (
        v * v * (1.0 + 2.0 * u) * node[i - 1, 2]
        + u * u * (1.0 + 2.0 * v) * node[i, 2]
        + u * v * length * (v * node[i - 1, 3] / node[i - 1, 4] - u * node[i, 3] / node[i, 4])
    )
    return left, math.atan(tangent), node[i - 1, 0] + u * (node[i, 0] - node[i - 1, 0])


def rows_to_read(horizon_y: float) -> np.ndarray:
    """Image rows (y up, ascending) that the tracker reads: every third near the vehicle, all of them far
    ahead, where a row covers many metres.
    """
    rows: list[int] = []
    y = 1
    while y < min(horizon_y - 4.0, HEIGHT_PX - 1):
        rows.append(y)
        below = horizon_y - y
        y += 3 if below > 42 else 2 if below > 22 else 1
    return np.array(rows, dtype=np.float64)
