"""Kernels on the RoadTable: pose, projection, borders, and the road ahead of the fleet.

`table` is a RoadTable, `path` an index into it, `s` a station on the path, `d` metres left of it. Before its
start and after its end a path goes straight on, except in `ahead`, which ends with the path.
"""

import math

import numpy as np

from sumo_net.compile import kernel
from sumo_net.frames import wrap_angle
from sumo_net.road_table import AHEAD_M, MAX_BORDERS, NO_MARKING, OWN_RIGHT, RoadAhead

_SIDE_WAYS = math.radians(80.0)  # a road that has turned further than this does not count as ahead


@kernel
def path_length(table, path):  # type: ignore[no-untyped-def]
    """Station of the path's end, m."""
    return (table.samples[path] - 1) * table.spacing_m[path]


@kernel
def pose_at(table, path, s):  # type: ignore[no-untyped-def]
    """(x, y, heading, curvature) of the path at station s.

    Between samples the position is the cubic with the samples' headings as tangents (off by h⁴κ³/384: 0.02 mm
    for R 5 m), the heading the cubic with their curvatures as slopes, the curvature linear.
    """
    first, last = table.first_sample[path], table.samples[path] - 1
    h = table.spacing_m[path]
    u = s / h
    if u <= 0.0 or u >= last:
        i = first if u <= 0.0 else first + last
        over = s if u <= 0.0 else s - last * h
        heading = table.heading_rad[i]
        curvature = table.curvature_1pm[i] if over == 0.0 else 0.0
        return (
            table.x_m[i] + over * math.cos(heading),
            table.y_m[i] + over * math.sin(heading),
            heading,
            curvature,
        )
    step = int(u)
    i, t = first + step, u - step
    a, b = table.heading_rad[i], table.heading_rad[i + 1]
    p, q = table.curvature_1pm[i], table.curvature_1pm[i + 1]
    # Cubic Hermite weights: value at the end, slope at the start, slope at the end.
    w1 = t * t * (3.0 - 2.0 * t)
    v0 = t * (1.0 - t) * (1.0 - t) * h
    v1 = t * t * (t - 1.0) * h
    x = table.x_m[i] + w1 * (table.x_m[i + 1] - table.x_m[i]) + v0 * math.cos(a) + v1 * math.cos(b)
    y = table.y_m[i] + w1 * (table.y_m[i + 1] - table.y_m[i]) + v0 * math.sin(a) + v1 * math.sin(b)
    return x, y, a + w1 * (b - a) + v0 * p + v1 * q, p + t * (q - p)


@kernel
def station_of(table, path, lane_position):  # type: ignore[no-untyped-def]
    """Station of a position along SUMO's lane, the path's own; beyond its ends, metre by metre."""
    start, end, length = table.own_start_m[path], table.own_end_m[path], table.own_length_m[path]
    if lane_position < 0.0:
        return start + lane_position
    if lane_position > length:
        return end + lane_position - length
    return start + lane_position * (end - start) / length


@kernel
def _newton(table, path, x, y, s):  # type: ignore[no-untyped-def]
    # Perpendicular foot near s: (s, d, found).
    length = path_length(table, path)
    d = 0.0
    for _ in range(20):
        px, py, heading, curvature = pose_at(table, path, s)
        c, n = math.cos(heading), math.sin(heading)
        along = c * (x - px) + n * (y - py)
        d = c * (y - py) - n * (x - px)
        if abs(along) < 1e-9:
            return s, d, True
        step = along / max(1.0 - curvature * d, 0.3)
        s += min(max(step, -10.0), 10.0)
        s = min(max(s, -200.0), length + 200.0)
    return s, d, abs(along) < 1e-4


@kernel
def project(table, path, x, y, s_guess):  # type: ignore[no-untyped-def]
    """(s, d) of a world point, with s near s_guess: by Newton; where that fails, from the nearest sample on.

    (NaN, NaN) for a point or a guess that is not finite.
    """
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(s_guess)):
        return math.nan, math.nan
    s, d, found = _newton(table, path, x, y, s_guess)
    if found and abs(d) < 15.0 and abs(s - s_guess) < 60.0:
        return s, d
    h, last = table.spacing_m[path], table.samples[path] - 1
    best, nearest = 0, math.inf
    for i in range(last + 1):
        at = table.first_sample[path] + i
        distance = math.hypot(table.x_m[at] - x, table.y_m[at] - y)
        distance += 0.01 * abs(i * h - s_guess)  # where the path crosses itself, the passage near the guess
        if distance < nearest:
            best, nearest = i, distance
    again, e, found_again = _newton(table, path, x, y, best * h)
    if found_again and (not found or abs(e) < abs(d)):
        return again, e
    if found:
        return s, d
    # No perpendicular foot (the point is at a centre of curvature): the nearest sample is taken.
    _, _, heading, _ = pose_at(table, path, best * h)
    at = table.first_sample[path] + best
    return best * h, math.cos(heading) * (y - table.y_m[at]) - math.sin(heading) * (x - table.x_m[at])


@kernel
def segment_at(table, path, s):  # type: ignore[no-untyped-def]
    """Row of the segment that contains station s (the first or the last one beyond the ends)."""
    low = table.first_segment[path]
    high = low + table.segments[path] - 1
    while low < high:
        middle = (low + high + 1) // 2
        if table.segment_start_m[middle] <= s:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def edge_station(table, segment, s):  # type: ignore[no-untyped-def]
    """Edge-anchored station at s, in a segment: the same for all paths at one place, so that dashes agree."""
    return table.anchor_m[segment] + (s - table.segment_start_m[segment]) * table.stretch[segment]


@kernel
def containing_lane(table, path, s, d):  # type: ignore[no-untyped-def]
    """The lane that contains (s, d), or the outermost one for a point beside all lanes.

    Returns (right border offset, left border offset, right kind, left kind, lanes_left, on_marked_road).
    lanes_left: position of the lane relative to the path's own, left positive. on_marked_road: on the
    asphalt, with at least one of the two borders painted.
    """
    g = segment_at(table, path, s)
    right = OWN_RIGHT
    while right > 0 and d < table.border_offset_m[g, right]:
        if math.isnan(table.border_offset_m[g, right - 1]):
            break
        right -= 1
    while right + 2 < MAX_BORDERS and d >= table.border_offset_m[g, right + 1]:
        if math.isnan(table.border_offset_m[g, right + 2]):
            break
        right += 1
    kind_right, kind_left = table.border_kind[g, right], table.border_kind[g, right + 1]
    on_road = table.road_right_m[g] <= d <= table.road_left_m[g]
    marked = kind_right != NO_MARKING or kind_left != NO_MARKING
    return (
        table.border_offset_m[g, right],
        table.border_offset_m[g, right + 1],
        kind_right,
        kind_left,
        right - OWN_RIGHT,
        on_road and marked,
    )


@kernel
def containing_lanes(table, path, s, d):  # type: ignore[no-untyped-def]
    """containing_lane for n vehicles: (right, left, kind right, kind left, lanes_left, on_marked_road)."""
    n = len(s)
    right, left = np.empty(n), np.empty(n)
    kind_right, kind_left = np.empty(n, np.int8), np.empty(n, np.int8)
    lanes_left, marked = np.empty(n, np.int32), np.empty(n, np.bool_)
    for k in range(n):
        right[k], left[k], kind_right[k], kind_left[k], lanes_left[k], marked[k] = containing_lane(
            table, path[k], s[k], d[k]
        )
    return right, left, kind_right, kind_left, lanes_left, marked


@kernel
def ahead(table, path, s, d, heading_error):  # type: ignore[no-untyped-def]
    """RoadAhead for n vehicles: path, s, d, heading_error (n,).

    The vehicle's centre of gravity is d left of the path at s, its heading that of the path plus
    heading_error. From where the path ends, has turned 80° away from the vehicle or comes back, values are
    NaN (and there is no marking). All are NaN for a vehicle with an input that is not finite.
    """
    n, J = len(s), len(AHEAD_M)
    station, forward, left = np.full((n, J), np.nan), np.full((n, J), np.nan), np.full((n, J), np.nan)
    heading, curvature = np.full((n, J), np.nan), np.full((n, J), np.nan)
    offset = np.full((n, J, MAX_BORDERS), np.nan)
    kind = np.zeros((n, J, MAX_BORDERS), np.int8)
    road_right, road_left = np.full((n, J), np.nan), np.full((n, J), np.nan)
    for k in range(n):
        if not math.isfinite(s[k] + d[k] + heading_error[k]):
            continue
        end = path_length(table, path[k])
        x0, y0, own, _ = pose_at(table, path[k], s[k])
        x0, y0 = x0 - d[k] * math.sin(own), y0 + d[k] * math.cos(own)
        own += heading_error[k]
        cos, sin = math.cos(own), math.sin(own)
        g = segment_at(table, path[k], s[k] + AHEAD_M[0])
        last = table.first_segment[path[k]] + table.segments[path[k]] - 1
        before = -math.inf
        for j in range(J):
            at = s[k] + AHEAD_M[j]
            if at > end:
                break
            x, y, direction, bend = pose_at(table, path[k], at)
            away = wrap_angle(direction - own)
            reach = cos * (x - x0) + sin * (y - y0)
            if AHEAD_M[j] > 0.0 and (abs(away) > _SIDE_WAYS or reach <= before):
                break
            before = reach
            while g < last and table.segment_start_m[g + 1] <= at:
                g += 1
            station[k, j] = edge_station(table, g, at)
            forward[k, j] = reach
            left[k, j] = cos * (y - y0) - sin * (x - x0)
            heading[k, j] = away
            curvature[k, j] = bend
            for b in range(MAX_BORDERS):
                offset[k, j, b] = table.border_offset_m[g, b]
                kind[k, j, b] = table.border_kind[g, b]
            road_right[k, j] = table.road_right_m[g]
            road_left[k, j] = table.road_left_m[g]
    return RoadAhead(station, forward, left, heading, curvature, offset, kind, road_right, road_left)
