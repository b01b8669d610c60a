"""Kernels of visibility: faces towards the radar, angular intervals, nearest visible points.

Two disjoint convex bodies have the same order along all rays that meet both. So one common ray shows which
hides the other, and it does so over the whole common interval.
"""

import math

import numpy as np

from sumo_net.compile import kernel
from sumo_net.frames import wrap_angle

_AHEAD_M = 1e-3  # faces are clipped here: no ray of a beam goes sideways or back
_SLIVER = 1e-9  # rad; narrower intervals are ignored
_BEYOND = 1.0 + 1e-9  # factor on a beam's squared range: rounding puts nothing from beyond it into the beam


@kernel
def _face(faces, count, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Add the part of a face that is ahead, its right end a and left end b; returns the new count."""
    if ax * by - ay * bx <= 1e-12:  # faces away, or edge-on
        return count
    if ax < _AHEAD_M and bx < _AHEAD_M:
        return count
    if ax < _AHEAD_M:
        t = (_AHEAD_M - ax) / (bx - ax)
        ax, ay = _AHEAD_M, ay + t * (by - ay)
    elif bx < _AHEAD_M:
        t = (_AHEAD_M - ax) / (bx - ax)
        bx, by = _AHEAD_M, ay + t * (by - ay)
    face = faces[count]
    face[0], face[1], face[2], face[3] = ax, ay, bx, by
    if count and ax == faces[0, 2] and ay == faces[0, 3]:  # at the corner between the two
        face[4] = faces[0, 5]
    else:
        face[4] = math.atan2(ay, ax)
    if count and bx == faces[0, 0] and by == faces[0, 1]:
        face[5] = faces[0, 4]
    else:
        face[5] = math.atan2(by, bx)
    return count + 1


@kernel
def _faces(x, y, c, s, length, width, faces):  # type: ignore[no-untyped-def]
    """The faces of a box towards the radar into `faces` (2, 6); returns their number.

    c, s: cosine and sine of the box's heading. A row: right end x, y, left end x, y, azimuths of both ends.
    """
    h, w = 0.5 * length, 0.5 * width
    # Corners counter-clockwise: front left, rear left, rear right, front right.
    x0, y0 = x + c * h - s * w, y + s * h + c * w
    x1, y1 = x - c * h - s * w, y - s * h + c * w
    x2, y2 = x - c * h + s * w, y - s * h - c * w
    x3, y3 = x + c * h + s * w, y + s * h - c * w
    # In counter-clockwise order, the ends of a face seen from outside go from left to right;
    # each is passed on from right to left.
    count = _face(faces, 0, x1, y1, x0, y0)
    count = _face(faces, count, x2, y2, x1, y1)
    if count < 2:
        count = _face(faces, count, x3, y3, x2, y2)
    if count < 2:
        count = _face(faces, count, x0, y0, x3, y3)
    return count


@kernel
def _reach(faces, count, angle, ux, uy):  # type: ignore[no-untyped-def]
    """Distance to the faces along a ray that meets them, in the direction (ux, uy) of the angle."""
    best, miss = math.inf, math.inf
    for f in range(count):
        ax, ay, bx, by = faces[f, 0], faces[f, 1], faces[f, 2], faces[f, 3]
        off = max(faces[f, 4] - angle, angle - faces[f, 5], 0.0)
        if off < miss or (off == 0.0 and miss == 0.0):
            dx, dy = bx - ax, by - ay
            r = (ax * dy - ay * dx) / (ux * dy - uy * dx)
            best = min(best, r) if off == miss else r
            miss = off
    return best


@kernel
def _nearest(face, low, high):  # type: ignore[no-untyped-def]
    """(distance, x, y) of the point of a face nearest to the radar between two azimuths; inf outside."""
    low, high = max(low, face[4]), min(high, face[5])
    if high - low < _SLIVER:
        return math.inf, 0.0, 0.0
    ax, ay, dx, dy = face[0], face[1], face[2] - face[0], face[3] - face[1]
    cross = ax * dy - ay * dx
    # The face's parameter from 0 to 1: of the foot of the perpendicular, and of both azimuths.
    foot = -(ax * dx + ay * dy) / (dx * dx + dy * dy)
    t0, t1 = 0.0, 1.0
    if low > face[4]:
        ux, uy = math.cos(low), math.sin(low)
        r = cross / (ux * dy - uy * dx)
        t0 = ((r * ux - ax) * dx + (r * uy - ay) * dy) / (dx * dx + dy * dy)
    if high < face[5]:
        ux, uy = math.cos(high), math.sin(high)
        r = cross / (ux * dy - uy * dx)
        t1 = ((r * ux - ax) * dx + (r * uy - ay) * dy) / (dx * dx + dy * dy)
    t = min(max(foot, t0), t1)
    x, y = ax + t * dx, ay + t * dy
    return math.hypot(x, y), x, y


@kernel
def _subtract(hidden, count, low, high, open_):  # type: ignore[no-untyped-def]
    """[low, high] without the `count` intervals `hidden` into `open_` (k, 2); returns the number left."""
    for i in range(1, count):  # sort by their beginnings
        a, b = hidden[i, 0], hidden[i, 1]
        j = i - 1
        while j >= 0 and hidden[j, 0] > a:
            hidden[j + 1, 0], hidden[j + 1, 1] = hidden[j, 0], hidden[j, 1]
            j -= 1
        hidden[j + 1, 0], hidden[j + 1, 1] = a, b
    left, at = 0, low
    for i in range(count):
        if hidden[i, 0] - at > _SLIVER:
            open_[left, 0], open_[left, 1] = at, hidden[i, 0]
            left += 1
        at = max(at, hidden[i, 1])
    if high - at > _SLIVER:
        open_[left, 0], open_[left, 1] = at, high
        left += 1
    return left


@kernel
def _second_point(px, py, x, y, c, s, length, further):  # type: ignore[no-untyped-def]
    """The point `further` along the body from its end towards the radar, laterally at (px, py).

    c, s: cosine and sine of the body's heading. The point is fixed lengthways on the body, whatever part of
    it is in view: while a truck is overtaken, its reflecting axle does not slide along it.
    """
    across = c * (py - y) - s * (px - x)
    end = max(0.5 * length - 0.5, 0.0)
    along = min(max(further - 0.5 * length, -end), end)
    if c * x + s * y < 0.0:  # the radar is at the front end
        along = -along
    return x + c * along - s * across, y + s * along + c * across


@kernel
def _in_beams(r, azimuth, radar):  # type: ignore[no-untyped-def]
    """Whether a point lies in the field of view."""
    for k in range(radar.beam_angle.size):
        if abs(azimuth) <= radar.beam_angle[k] and radar.minimum_range <= r <= radar.beam_range[k]:
            return True
    return False


@kernel
def look(objects, motion, radar, out):  # type: ignore[no-untyped-def]
    """Sightings of n vehicles into `out`, which must be NaN."""
    n, M = objects.forward_m.shape
    faces, count = np.empty((M, 2, 6)), np.zeros(M, np.int64)
    cos, sin = np.empty(M), np.empty(M)  # of the headings
    low, high = np.empty(M), np.empty(M)
    near, far = np.empty(M), np.empty(M)  # squared
    hidden, open_ = np.empty((M, 2)), np.empty((M + 1, 2))
    hiding = np.empty(M, np.int64)  # bodies that can hide others; posts cannot
    for i in range(n):
        # The radar's own velocity over ground: that of the centre of gravity and of the turn about it.
        own_x = motion.speed_mps[i] - motion.yaw_rate_rps[i] * radar.left
        own_y = motion.lateral_speed_mps[i] + motion.yaw_rate_rps[i] * radar.forward
        for m in range(M):
            count[m] = 0
            if objects.handle[i, m] == -1:
                continue
            x, y = objects.forward_m[i, m] - radar.forward, objects.left_m[i, m] - radar.left
            cos[m], sin[m] = math.cos(objects.heading_rad[i, m]), math.sin(objects.heading_rad[i, m])
            count[m] = _faces(x, y, cos[m], sin[m], objects.length_m[i, m], objects.width_m[i, m], faces[m])
            low[m], high[m], near[m], far[m] = math.inf, -math.inf, math.inf, 0.0
            for f in range(count[m]):
                ax, ay, bx, by = faces[m, f, 0], faces[m, f, 1], faces[m, f, 2], faces[m, f, 3]
                low[m], high[m] = min(low[m], faces[m, f, 4]), max(high[m], faces[m, f, 5])
                dx, dy = bx - ax, by - ay
                t = min(max(-(ax * dx + ay * dy) / (dx * dx + dy * dy), 0.0), 1.0)
                x, y = ax + t * dx, ay + t * dy
                near[m] = min(near[m], x * x + y * y)
                far[m] = max(far[m], ax * ax + ay * ay, bx * bx + by * by)
        hiders = 0
        for m in range(M):
            if count[m] > 0 and max(objects.length_m[i, m], objects.width_m[i, m]) >= radar.least_hiding:
                hiding[hiders] = m
                hiders += 1
        for m in range(M):
            if count[m] == 0:
                continue
            covers = 0
            for h in range(hiders):
                k = hiding[h]
                if near[k] >= far[m] or low[k] >= high[m] or high[k] <= low[m] or k == m:
                    continue
                a, b = max(low[m], low[k]), min(high[m], high[k])
                if b - a <= _SLIVER:
                    continue
                middle = 0.5 * (a + b)
                hides = far[k] <= near[m]
                if not hides:
                    ux, uy = math.cos(middle), math.sin(middle)
                    reach = _reach(faces[k], count[k], middle, ux, uy)
                    hides = reach < _reach(faces[m], count[m], middle, ux, uy)
                if hides:
                    hidden[covers, 0], hidden[covers, 1] = a, b
                    covers += 1
            left = _subtract(hidden, covers, low[m], high[m], open_)
            nearest, px, py, angle = math.inf, 0.0, 0.0, 0.0
            for beam in range(radar.beam_angle.size):
                if near[m] > _BEYOND * radar.beam_range[beam] * radar.beam_range[beam]:
                    continue
                edge, best, bx, by, seen = radar.beam_angle[beam], math.inf, 0.0, 0.0, 0.0
                for j in range(left):
                    a, b = max(open_[j, 0], -edge), min(open_[j, 1], edge)
                    seen += max(b - a, 0.0)
                    for f in range(count[m]):
                        r, qx, qy = _nearest(faces[m, f], a, b)
                        if r < best:
                            best, bx, by = r, qx, qy
                if best <= radar.beam_range[beam] and best >= radar.minimum_range:
                    angle = max(angle, seen)
                    if best < nearest:
                        nearest, px, py = best, bx, by
            if nearest == math.inf:
                continue
            vx, vy = objects.speed_mps[i, m] * cos[m], objects.speed_mps[i, m] * sin[m]
            out.vx_mps[i, m], out.vy_mps[i, m] = vx, vy
            out.range_m[i, m] = nearest
            out.azimuth_rad[i, m] = math.atan2(py, px)
            # The vehicle's yaw rate moves the point only across the line of sight.
            out.range_rate_mps[i, m] = ((vx - own_x) * px + (vy - own_y) * py) / nearest
            out.width_m[i, m] = nearest * angle
            out.share[i, m] = angle / (high[m] - low[m])
            if objects.length_m[i, m] >= radar.long_body:
                x, y = objects.forward_m[i, m] - radar.forward, objects.left_m[i, m] - radar.left
                sx, sy = _second_point(px, py, x, y, cos[m], sin[m], objects.length_m[i, m], radar.second)
                r, azimuth = math.hypot(sx, sy), math.atan2(sy, sx)
                clear = False
                for j in range(left):
                    clear = clear or open_[j, 0] <= azimuth <= open_[j, 1]
                if clear and _in_beams(r, azimuth, radar):
                    out.second_range_m[i, m], out.second_azimuth_rad[i, m] = r, azimuth
                    out.second_range_rate_mps[i, m] = ((vx - own_x) * sx + (vy - own_y) * sy) / r


@kernel
def _may_be_seen(forward, left, size, edges, radar):  # type: ignore[no-untyped-def]
    """Whether a body with half-diagonal `size`, centred at (forward, left) of the radar, may be in a beam.

    edges (beams, 2): cosine and sine of the beams' half angles.
    """
    if not forward > -size:
        return False
    r = math.hypot(forward, left)
    for k in range(radar.beam_angle.size):
        outside = abs(left) * edges[k, 0] - forward * edges[k, 1]
        if r - size <= radar.beam_range[k] and outside <= size:
            return True
    return False


@kernel
def ascending(values, count, order):  # type: ignore[no-untyped-def]
    """Indices that sort the first `count` values, into `order`; stable.

    Insertion sort: there are some dozens, and numba's own sorting takes long to compile.
    """
    for i in range(count):
        j = i
        while j > 0 and values[order[j - 1]] > values[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i


@kernel
def _first_from(values, least):  # type: ignore[no-untyped-def]
    """Index of the first of the ascending `values` that is at least `least`."""
    low, high = 0, values.size
    while low < high:
        middle = (low + high) // 2
        if values[middle] < least:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def gather(handle, x, y, heading, snapshot, roadside, radar, most):  # type: ignore[no-untyped-def]
    """Objects in view of n vehicles: handles (n, M), -1 for unused, and the other fields (7, n, M) in order.

    M: largest number of any vehicle, at least 1 and at most `most`.
    """
    n, vehicles, posts = len(x), snapshot.handle.size, roadside.handle.size
    index, distance = np.empty(vehicles + posts, np.int64), np.empty(vehicles + posts)
    order = np.empty(vehicles + posts, np.int64)
    nearest, used, M = np.empty((n, most), np.int64), np.zeros(n, np.int64), 1
    furthest, edges = 0.0, np.empty((radar.beam_angle.size, 2))
    for k in range(radar.beam_range.size):
        edges[k, 0], edges[k, 1] = math.cos(radar.beam_angle[k]), math.sin(radar.beam_angle[k])
        furthest = max(furthest, radar.beam_range[k] + 30.0)
    back_x, back_y = np.empty(vehicles), np.empty(vehicles)  # from the centre to the front bumper
    size = np.empty(vehicles + posts)  # half-diagonals
    for k in range(vehicles):
        half = 0.5 * snapshot.length_m[k]
        back_x[k] = half * math.cos(snapshot.heading_rad[k])
        back_y[k] = half * math.sin(snapshot.heading_rad[k])
        size[k] = math.hypot(0.5 * snapshot.length_m[k], 0.5 * snapshot.width_m[k])
    for k in range(posts):
        size[vehicles + k] = 0.5 * math.hypot(roadside.length_m[k], roadside.width_m[k])
    for i in range(n):
        if not (math.isfinite(x[i]) and math.isfinite(y[i])):
            continue
        c, s = math.cos(heading[i]), math.sin(heading[i])
        found = 0
        for k in range(vehicles):
            dx, dy = snapshot.x_m[k] - x[i], snapshot.y_m[k] - y[i]
            if dx * dx + dy * dy > furthest * furthest or snapshot.handle[k] == handle[i]:
                continue
            dx -= back_x[k]
            dy -= back_y[k]
            forward, left = c * dx + s * dy, c * dy - s * dx
            if _may_be_seen(forward - radar.forward, left - radar.left, size[k], edges, radar):
                index[found], distance[found] = k, math.hypot(forward, left)
                found += 1
        first = _first_from(roadside.x_m, x[i] - furthest)
        while first < posts and roadside.x_m[first] <= x[i] + furthest:
            dx, dy = roadside.x_m[first] - x[i], roadside.y_m[first] - y[i]
            forward, left = c * dx + s * dy, c * dy - s * dx
            if _may_be_seen(forward - radar.forward, left - radar.left, size[vehicles + first], edges, radar):
                index[found], distance[found] = vehicles + first, math.hypot(forward, left)
                found += 1
            first += 1
        ascending(distance, found, order)
        used[i] = min(found, most)
        M = max(M, used[i])
        for m in range(used[i]):
            nearest[i, m] = index[order[m]]
    who, out = np.full((n, M), -1, np.int64), np.full((7, n, M), math.nan)
    for i in range(n):
        c, s = math.cos(heading[i]), math.sin(heading[i])
        for m in range(used[i]):
            k = nearest[i, m]
            if k < vehicles:
                dx = snapshot.x_m[k] - back_x[k] - x[i]
                dy = snapshot.y_m[k] - back_y[k] - y[i]
                who[i, m] = snapshot.handle[k]
                out[2, i, m] = wrap_angle(snapshot.heading_rad[k] - heading[i])
                out[3, i, m], out[4, i, m] = snapshot.speed_mps[k], snapshot.length_m[k]
                out[5, i, m], out[6, i, m] = snapshot.width_m[k], snapshot.height_m[k]
            else:
                k -= vehicles
                dx, dy = roadside.x_m[k] - x[i], roadside.y_m[k] - y[i]
                who[i, m] = roadside.handle[k]
                out[2, i, m] = wrap_angle(roadside.heading_rad[k] - heading[i])
                out[3, i, m], out[4, i, m] = 0.0, roadside.length_m[k]
                out[5, i, m], out[6, i, m] = roadside.width_m[k], roadside.height_m[k]
            out[0, i, m], out[1, i, m] = c * dx + s * dy, c * dy - s * dx
    return who, out
