"""The road's lines as curves over the ground distance, and the share of each pixel that they cover.

Camera frame on the ground: `ahead` along the camera's horizontal direction, `aside` to its left, origin below
the camera. An image row is a line of constant `ahead`, so a line of the road is tabulated as aside(ahead): a
cubic Hermite piece between the stations of RoadAhead, with the slope that follows from the path's heading and
curvature and the line's own offset.
"""

import math
from typing import NamedTuple

import numpy as np

from camera_synth.camera import WIDTH_PX
from sumo_net.arrays import Array
from sumo_net.compile import inlined, kernel
from sumo_net.road import MAX_BORDERS

RIGHT_EDGE, LEFT_EDGE, PATH = MAX_BORDERS, MAX_BORDERS + 1, MAX_BORDERS + 2
CURVES = MAX_BORDERS + 3
FARTHEST_M = 3000.0  # rows that reach beyond are drawn as if they ended there
VECTOR = 16  # float32 values in the longest vector register
_MIN_FORWARD = 0.05  # least cosine between a line and the camera's direction for following the line


class Curves(NamedTuple):
    """Scratch for one vehicle: the markings, both asphalt edges and the path as aside(ahead)."""

    first: Array  # (CURVES,) int64, the first piece in use
    last: Array  # (CURVES,) int64, one past the last piece in use, 0 for none
    start: Array  # (CURVES, J) ahead where a piece begins; entry `last` is the last one's end
    cubic: Array  # (CURVES, J, 4) aside over ahead - start
    offset: Array  # (CURVES, J) left of the path; stays 0 for the path itself
    kind: Array  # (CURVES, J) int8, 0: nothing
    pose: Array  # (J, 5) of the path at each sample: ahead, aside, cosine and sine of its heading, curvature
    station: Array  # (J,) at each sample
    length: Array  # (J,) from a sample to the next
    advance: Array  # (J,) the same by edge-anchored stations; the length where the next edge restarts them
    goes_on: Array  # (1,) bool: the road goes on beyond the last sample


class Crossings(NamedTuple):
    """Scratch for one vehicle: where the curves cross the edges between image rows.

    For drawing, entry e is the line at image height e - 0.5, so row y lies between entries y and y + 1.
    """

    ahead: Array  # (rows + 1,)
    magnify: Array  # (rows + 1,) columns per metre sideways
    kind: Array  # (CURVES, rows + 1) int8, 0 where the curve does not cross
    column: Array  # (CURVES, rows + 1)
    scale: Array  # (CURVES, rows + 1) columns per metre across the curve
    station: Array  # (CURVES, rows + 1)
    aside: Array  # (CURVES, rows + 1)
    slope: Array  # (CURVES, rows + 1) d aside / d ahead


@kernel
def new_curves(samples):  # type: ignore[no-untyped-def]
    """Empty Curves for J = `samples`."""
    return Curves(
        np.zeros(CURVES, np.int64),
        np.zeros(CURVES, np.int64),
        np.zeros((CURVES, samples)),
        np.zeros((CURVES, samples, 4)),
        np.zeros((CURVES, samples)),
        np.zeros((CURVES, samples), np.int8),
        np.zeros((samples, 5)),
        np.zeros(samples),
        np.zeros(samples),
        np.zeros(samples),
        np.zeros(1, np.bool_),
    )


@kernel
def new_crossings(rows):  # type: ignore[no-untyped-def]
    """Empty Crossings for image rows 0 to `rows` - 1."""
    return Crossings(
        np.zeros(rows + 1),
        np.zeros(rows + 1),
        np.zeros((CURVES, rows + 1), np.int8),
        np.zeros((CURVES, rows + 1)),
        np.zeros((CURVES, rows + 1)),
        np.zeros((CURVES, rows + 1)),
        np.zeros((CURVES, rows + 1)),
        np.zeros((CURVES, rows + 1)),
    )


@kernel
def tabulate(curves, road, i, p):  # type: ignore[no-untyped-def]
    """Fill `curves` from vehicle i of a RoadAhead, seen by a camera with Projection p."""
    forward, left, heading = road.forward_m[i], road.left_m[i], road.heading_rad[i]
    samples = forward.shape[0]
    first = 0
    while first < samples and math.isnan(forward[first]):
        first += 1
    known = first
    while known < samples and not math.isnan(forward[known]):
        known += 1
    curves.goes_on[0] = known == samples
    pose, bend = curves.pose, road.curvature_1pm[i]
    for j in range(first, known):
        f, g = forward[j] - p.forward, left[j] - p.left
        sin_h, cos_h = math.sin(heading[j]), math.cos(heading[j])
        pose[j, 0] = p.cos_yaw * f + p.sin_yaw * g
        pose[j, 1] = -p.sin_yaw * f + p.cos_yaw * g
        pose[j, 2] = p.cos_yaw * cos_h + p.sin_yaw * sin_h
        pose[j, 3] = p.cos_yaw * sin_h - p.sin_yaw * cos_h
        pose[j, 4] = bend[j]
    station = road.station_m[i]
    for j in range(first, known - 1):
        chord = math.sqrt((pose[j + 1, 0] - pose[j, 0]) ** 2 + (pose[j + 1, 1] - pose[j, 1]) ** 2)
        turn = 0.5 * (bend[j] + bend[j + 1]) * chord
        length = chord * (1.0 + turn * turn / 24.0)  # arc length from the chord
        counted = station[j + 1] - station[j]
        curves.length[j] = length
        curves.advance[j] = counted if abs(counted - length) < 0.3 * length else length
    border, kind = road.border_offset_m[i], road.border_kind[i]
    right, left = road.road_right_m[i], road.road_left_m[i]
    offset, used = curves.offset, curves.kind
    for k in range(CURVES):
        curves.last[k] = 0
        marked = k >= MAX_BORDERS
        for j in range(first, known):
            used[k, j] = 1
            if k < MAX_BORDERS:
                offset[k, j], used[k, j] = border[j, k], kind[j, k]
                marked = marked or kind[j, k] != 0
            elif k == RIGHT_EDGE:
                offset[k, j] = right[j]
            elif k == LEFT_EDGE:
                offset[k, j] = left[j]
        if marked:
            _tabulate_curve(curves, k, first, known)
    for j in range(first, known):
        curves.station[j] = station[j]


@kernel
def _tabulate_curve(curves, k, first, known):  # type: ignore[no-untyped-def]
    pose, lengths, start, cubic = curves.pose, curves.length, curves.start, curves.cubic
    offset, kind = curves.offset, curves.kind
    curves.first[k] = first
    last = 0
    for j in range(first, known - 1):
        d0, d1 = offset[k, j], offset[k, j + 1]
        seen = not (math.isnan(d0) or math.isnan(d1))
        if not seen:  # keep the pieces in step with the path; nothing is drawn on them
            d0 = 0.0 if math.isnan(d0) else d0
            d1 = d0 if math.isnan(d1) else d1
        length = lengths[j]
        rate = (d1 - d0) / length if seen else 0.0
        a0, b0, m0 = _point(pose, j, d0, rate)
        a1, b1, m1 = _point(pose, j + 1, d1, rate)
        run = a1 - a0
        if not (run > _MIN_FORWARD * length) or math.isnan(m0) or math.isnan(m1):
            break
        slope = (b1 - b0) / run
        start[k, j] = a0
        start[k, j + 1] = a1
        cubic[k, j, 0] = b0
        cubic[k, j, 1] = m0
        cubic[k, j, 2] = (3.0 * slope - 2.0 * m0 - m1) / run
        cubic[k, j, 3] = (m0 + m1 - 2.0 * slope) / (run * run)
        if not seen:
            kind[k, j] = 0
        last = j + 1
    curves.last[k] = last


@kernel
def _point(pose, j, d, rate):  # type: ignore[no-untyped-def]
    """(ahead, aside, d aside / d ahead) of the line at offset d, changing at `rate` per metre of path."""
    c, s = pose[j, 2], pose[j, 3]
    along = 1.0 - pose[j, 4] * d
    run = along * c - rate * s
    slope = (along * s + rate * c) / run if run > _MIN_FORWARD else math.nan
    return pose[j, 0] - d * s, pose[j, 1] + d * c, slope


@kernel
def row_line(y, p):  # type: ignore[no-untyped-def]
    """(ahead, depth) of the ground line seen at image height y, both clipped at FARTHEST_M."""
    t = (y - p.center_y) / p.focal_y
    fall = p.sin_pitch - t * p.cos_pitch
    rise = p.height * (p.cos_pitch + t * p.sin_pitch)
    ahead = rise / fall if fall * FARTHEST_M > rise else FARTHEST_M
    return ahead, p.cos_pitch * ahead + p.sin_pitch * p.height


@kernel
def lay(crossings, lowest, p):  # type: ignore[no-untyped-def]
    """Set the ground lines of `crossings`; entry e is at image height `lowest` + e."""
    for e in range(crossings.ahead.shape[0]):
        crossings.ahead[e], depth = row_line(np.float64(lowest + e), p)
        crossings.magnify[e] = p.focal / depth


@kernel
def cross(crossings, curves, p):  # type: ignore[no-untyped-def]
    """Fill `crossings`, prepared by `lay`, from `curves` for a camera with Projection p."""
    for k in range(CURVES):
        cross_curve(crossings, curves, k, p)


@kernel
def cross_curve(crossings, curves, k, p):  # type: ignore[no-untyped-def]
    """Where curve k alone crosses the lines of `crossings`."""
    last = curves.last[k]
    if last == 0:
        for e in range(crossings.ahead.shape[0]):
            crossings.kind[k, e] = 0
        return
    endless = curves.goes_on[0] and last == curves.start.shape[1] - 1
    _cross_curve(crossings, k, curves, curves.first[k], last, endless, p)


@kernel
def _cross_curve(crossings, k, curves, first, last, endless, p):  # type: ignore[no-untyped-def]
    ahead_of, kind, column = crossings.ahead, crossings.kind, crossings.column
    scale, station, aside_of, slope_of = crossings.scale, crossings.station, crossings.aside, crossings.slope
    start, cubic, passed, advance = curves.start, curves.cubic, curves.station, curves.advance
    pieces, magnify = curves.kind, crossings.magnify
    j = first
    end = start[k, j + 1] - start[k, j]
    rate = advance[j] / end
    for e in range(ahead_of.shape[0]):
        ahead = ahead_of[e]
        while j < last - 1 and ahead >= start[k, j + 1]:
            j += 1
            end = start[k, j + 1] - start[k, j]
            rate = advance[j] / end
        u = ahead - start[k, j]
        if u > end and not endless:
            kind[k, e] = 0
            continue
        v = min(max(u, 0.0), end)
        outside = u - v  # straight on before the first sample and beyond the last
        c1, c2, c3 = cubic[k, j, 1], cubic[k, j, 2], cubic[k, j, 3]
        slope = c1 + v * (2.0 * c2 + v * 3.0 * c3)
        aside = cubic[k, j, 0] + v * (c1 + v * (c2 + v * c3)) + slope * outside
        stretch = math.sqrt(1.0 + slope * slope)
        kind[k, e] = pieces[k, j]
        aside_of[k, e] = aside
        slope_of[k, e] = slope
        column[k, e] = p.center_x - magnify[e] * aside
        scale[k, e] = stretch * magnify[e]
        station[k, e] = passed[j] + v * rate + stretch * outside


@kernel
def whole_vectors(first, end):  # type: ignore[no-untyped-def]
    """(first, end) of the whole vectors that contain these pixels of a row; empty where none is in it.

    Loops over whole vectors have no remainder; they must not change the other pixels in them.
    """
    first, end = min(max(first, 0), WIDTH_PX), min(max(end, 0), WIDTH_PX)
    return first // VECTOR * VECTOR, (end + VECTOR - 1) // VECTOR * VECTOR


@inlined
def _right_of(a, b, per_width):  # type: ignore[no-untyped-def]
    """Mean of clip(t, 0, 1) over t from b to a = b + 1 / per_width: the share of a pixel right of an edge.

    Over the row's height, the edge's distance left of the pixel's right side goes from a to b.
    """
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    low_a, low_b = min(max(a, zero), one), min(max(b, zero), one)
    return (half * (low_a - low_b) * (low_a + low_b) + (max(a, one) - max(b, one))) * per_width


@kernel
def _apart(e0, e1):  # type: ignore[no-untyped-def]
    """The ends of an edge, the lesser first, far enough apart for float32."""
    middle, half = 0.5 * (e0 + e1), max(0.5 * abs(e1 - e0), 0.005)
    return middle - half, middle + half


@kernel
def paint_band(row, l0, l1, r0, r1, grey, opacity):  # type: ignore[no-untyped-def]
    """Blend `grey` into the row between a left edge l0 -> l1 and a right edge r0 -> r1 (bottom -> top)."""
    l0, l1 = _apart(l0, l1)
    r0, r1 = _apart(r0, r1)
    first, end = whole_vectors(math.floor(l0 + 0.5), math.floor(r1 + 0.5) + 1)
    part = row[first:end]
    side = first + 0.5  # the first pixel's right side
    l_a, l_b, per_l = np.float32(side - l0), np.float32(side - l1), np.float32(1.0 / (l1 - l0))
    r_a, r_b, per_r = np.float32(side - r0), np.float32(side - r1), np.float32(1.0 / (r1 - r0))
    share, level = np.float32(opacity), np.float32(grey)
    for x in range(part.shape[0]):
        f = np.float32(np.int32(x))
        cover = _right_of(f + l_a, f + l_b, per_l) - _right_of(f + r_a, f + r_b, per_r)
        part[x] += cover * share * (level - part[x])


@kernel
def paint_dashes(row, l0, l1, r0, r1, phase, length, stroke, period, grey, opacity):  # type: ignore[no-untyped-def]
    """As paint_band, for a line painted where (station mod period) < stroke.

    The row spans `length` from `phase` on. A stroke that begins or ends in the row covers its part of the
    row's trapezoid; rows longer than a period get the share of paint in them.
    """
    if length >= period:
        whole = math.floor((phase + length) / period)
        rest = phase + length - whole * period
        painted = whole * stroke + min(rest, stroke) - min(phase, stroke)
        paint_band(row, l0, l1, r0, r1, grey, opacity * painted / length)
        return
    if length <= 1e-9:
        if phase < stroke:
            paint_band(row, l0, l1, r0, r1, grey, opacity)
        return
    begin = -phase
    while begin < length:
        a, b = max(begin, 0.0) / length, min(begin + stroke, length) / length
        if b > a:
            paint_band(
                row,
                l0 + a * (l1 - l0),
                l0 + b * (l1 - l0),
                r0 + a * (r1 - r0),
                r0 + b * (r1 - r0),
                grey,
                opacity * (b - a),
            )
        begin += period
