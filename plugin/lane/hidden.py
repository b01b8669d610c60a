"""Parts of the road that vehicles ahead hide, from the radar's tracks: they are not searched for paint.

A body's edges, lamps and tyres are as bright, narrow and slanted as paint. The camera alone detects only a
body in the own lane (`plugin.lane.body`). For the others, the tracks of the previous step give the nearest
point of each, and the dark strip under it in the image its width.
"""

import math
from typing import NamedTuple

import numpy as np

from camera_synth.camera import Projection, image_from_vehicle
from sumo_net.arrays import Array
from sumo_net.compile import kernel

BODIES = 8  # of each vehicle, the nearest
NEAREST_M, FURTHEST_M, ASIDE_M = 5.0, 100.0, 9.0
BODY_WIDTH_M, BODY_LENGTH_M = 2.3, 4.5
MARGIN_M, MARGIN_PX = 0.1, 2.0
FOOT, FIRST, LAST, POINT, SCALE, FAR, COLUMNS = range(7)  # of a body's row in `hidden`
STRIP_M, STRIP_DARK = 0.35, 0.65  # height of the dark strip, and its largest grey over the road's
STRIP_FROM_M, STRIP_NARROW_M, STRIP_WIDE_M = 0.8, 1.0, 3.4  # largest distance from the point; its width
ROAD_NEARER_M = 3.0  # the road's grey is read this much nearer than the body
STRAIGHT_AHEAD_M, WELL_ASIDE_M = 0.4, 2.2


class Bodies(NamedTuple):
    """Nearest points of B bodies ahead of the fleet's vehicles, (B,) each."""

    owner: Array  # int64, row of the fleet's vehicle
    x_m: Array  # nearest point, from the owner's centre of gravity
    y_m: Array
    course_rad: Array  # direction of the body's axis relative to the owner's, left positive
    course_std_rad: Array


def nothing_hidden(n: int) -> Array:
    """(n, BODIES, COLUMNS) of n vehicles without bodies ahead."""
    out = np.zeros((n, BODIES, COLUMNS))
    out[:, :, FOOT] = np.inf
    return out


def hidden_by(bodies: Bodies, n: int, projection: Projection, radar_forward_m: float) -> Array:
    """(n, BODIES, COLUMNS): first row (y up), first and last column in which each body hides the road.

    Also the nearest point's column, pixels per metre there, and its distance over that of the body's far end.
    The points are those nearest to a radar `radar_forward_m` ahead of the centre of gravity.
    """
    out = nothing_hidden(n)
    order = np.lexsort((bodies.x_m, bodies.owner))
    _mask(Bodies(*(part[order] for part in bodies)), projection, radar_forward_m, out)
    return out


@kernel
def _mask(bodies, p, radar_forward_m, out):  # type: ignore[no-untyped-def]
    owner, used, before = bodies.owner, 0, -1
    for b in range(len(owner)):
        i = owner[b]
        used = 0 if i != before else used
        before = i
        x, y = bodies.x_m[b], bodies.y_m[b]
        if used >= BODIES or not (NEAREST_M < x < FURTHEST_M and abs(y) < ASIDE_M):
            continue
        column, foot, depth = image_from_vehicle(x, y, 0.0, p)
        if depth <= 0.0:
            continue
        out[i, used, POINT], out[i, used, SCALE] = column, p.focal / depth
        out[i, used, FAR] = x / (x + BODY_LENGTH_M)
        left, right = _extent(x - radar_forward_m, y, bodies.course_rad[b], bodies.course_std_rad[b])
        drift = BODY_LENGTH_M * math.sin(bodies.course_rad[b])  # lateral position of its far end
        first, last = math.inf, -math.inf
        for end in range(2):
            for side in range(2):
                aside = y + end * drift + (left if side == 0 else -right)
                column, _, depth = image_from_vehicle(x + end * BODY_LENGTH_M, aside, 0.0, p)
                if depth > 0.0:
                    first, last = min(first, column), max(last, column)
        out[i, used, FOOT], out[i, used, FIRST], out[i, used, LAST] = foot, first, last
        used += 1


@kernel
def _extent(x, y, course, course_std):  # type: ignore[no-untyped-def]
    """(left, right): how far a body extends to either side of its point (x, y) nearest to the radar, in m.

    If the body's axis passes beside the radar, the point is its inner corner; if the body heads straight
    away, the point may be anywhere on its rear. Between, or if the course is too uncertain, it may be either
    corner.
    """
    beside = y * math.cos(course) - x * math.sin(course)  # lateral distance from the radar across the course
    sure = min(STRAIGHT_AHEAD_M + abs(x) * course_std, WELL_ASIDE_M)
    if abs(beside) < STRAIGHT_AHEAD_M:
        return 0.5 * BODY_WIDTH_M, 0.5 * BODY_WIDTH_M
    if beside > sure:
        return BODY_WIDTH_M, MARGIN_M
    if beside < -sure:
        return MARGIN_M, BODY_WIDTH_M
    return BODY_WIDTH_M, BODY_WIDTH_M


@kernel
def outline(frame, hidden, p):  # type: ignore[no-untyped-def]
    """Narrow each body of one vehicle's `hidden` (BODIES, COLUMNS) to its outline in the frame, if found."""
    height, width = frame.shape
    vanishing_x = p.center_x + p.focal * p.sin_yaw / p.cos_yaw
    vanishing_y = p.center_y + p.focal_y * p.sin_pitch / p.cos_pitch
    for b in range(hidden.shape[0]):
        foot, scale, point = hidden[b, FOOT], hidden[b, SCALE], hidden[b, POINT]
        if not math.isfinite(foot):
            break
        distance = p.height * p.focal_y / max(vanishing_y - foot, 1.0)
        nearer = vanishing_y - (vanishing_y - foot) * distance / max(distance - ROAD_NEARER_M, 1.0)
        below = height - 1 - round(max(nearer, 0.0))
        low, high = max(round(point - scale), 0), min(round(point + scale), width - 1)
        if below < height and high - low >= 2:
            road = 0.0
            for c in range(low, high + 1):
                road += frame[below, c]
            dark = STRIP_DARK * road / (high - low + 1)
            widest, first, last = 0, 0, -1
            # the foot is uncertain by a pixel or two
            for up in range(round(foot) - 1, round(foot + STRIP_M * scale) + 2):
                row = height - 1 - up
                if 0 <= row < height:
                    one, other = _strip(frame, row, point, STRIP_FROM_M * scale, dark)
                    cut = one <= 1 or other >= width - 2  # extends beyond the image
                    wide = (other - one + 1) / scale
                    fits = STRIP_NARROW_M <= wide <= STRIP_WIDE_M or (cut and other > one + 1)
                    if fits and other - one > widest:
                        widest, first, last = other - one, one, other
            if widest > 0:
                # including the side of the body, up to its far end
                hidden[b, FIRST] = min(first, vanishing_x + (first - vanishing_x) * hidden[b, FAR])
                hidden[b, LAST] = max(last, vanishing_x + (last - vanishing_x) * hidden[b, FAR])
                if first <= 1:
                    hidden[b, FIRST] = -math.inf
                if last >= width - 2:
                    hidden[b, LAST] = math.inf
        hidden[b, FIRST] -= MARGIN_PX
        hidden[b, LAST] += MARGIN_PX
        hidden[b, FOOT] -= MARGIN_PX


@kernel
def _strip(frame, row, point, reach, dark):  # type: ignore[no-untyped-def]
    """(first, last) of the dark run of a row that begins within `reach` of column `point`; (0, -1) for none.

    A single brighter pixel does not end it.
    """
    width = frame.shape[1]
    start, nearest = -1, math.inf
    for c in range(max(round(point - reach), 0), min(round(point + reach), width - 1) + 1):
        if frame[row, c] < dark and abs(c - point) < nearest:
            start, nearest = c, abs(c - point)
    if start < 0:
        return 0, -1
    first, last = start, start
    while first > 0 and (frame[row, first - 1] < dark or frame[row, max(first - 2, 0)] < dark):
        first -= 1
    while last < width - 1 and (frame[row, last + 1] < dark or frame[row, min(last + 2, width - 1)] < dark):
        last += 1
    return first, last


@kernel
def without_hidden(ridge, count, y, hidden):  # type: ignore[no-untyped-def]
    """Drop the ridges (count, 2) of row y whose column a body hides; returns the number left."""
    kept = 0
    for c in range(count):
        if not is_hidden(ridge[c, 0], y, hidden):
            ridge[kept, 0], ridge[kept, 1] = ridge[c, 0], ridge[c, 1]
            kept += 1
    return kept


@kernel
def is_hidden(column, y, hidden):  # type: ignore[no-untyped-def]
    """Whether a body hides the road at a column of row y."""
    for b in range(hidden.shape[0]):
        if y >= hidden[b, FOOT] and hidden[b, FIRST] <= column <= hidden[b, LAST]:
            return True
    return False
