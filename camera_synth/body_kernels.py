"""Bodies as boxes: their visible faces as polygons in the image, far ones first."""

import math
from typing import NamedTuple

import numpy as np

from camera_synth.camera import WIDTH_PX
from camera_synth.degrade import contrast_left, lattice_unit
from camera_synth.ground_kernels import whole_vectors
from sumo_net.arrays import Array
from sumo_net.compile import inlined, kernel

POLYGONS = 20  # at most for one body
PANELS = 6  # at most on one face
_VERTICES = 6
_NEAREST_M = 0.3  # depth at which faces are cut off
_UNUSED = -1
_DARK = 22.0  # grey of tyres, and under a vehicle


class Bodies(NamedTuple):
    """Scratch for one vehicle: the visible bodies around it, in painter's order."""

    used: Array  # (1,) int64, number of bodies in view
    polygons: Array  # (M,) int64, number of polygons of each
    vertex: Array  # (M, POLYGONS, _VERTICES, 2)
    vertices: Array  # (M, POLYGONS) int64
    bottom: Array  # (M, POLYGONS) image height of the lowest vertex
    top: Array  # (M, POLYGONS) of the highest
    grey: Array  # (M, POLYGONS)
    opacity: Array  # (M, POLYGONS)
    whole: Array  # (M, POLYGONS) bool: a whole face, neither the shadow nor a panel on a face
    order: Array  # (M,) int64
    distance: Array  # (M,) m
    panel: Array  # (PANELS, 5) of a face: fractions of its width from, to; heights from, to in m; grey
    corner: Array  # (4, 3) of a panel, in the camera frame: depth, right, up


class Box(NamedTuple):
    """A body's footprint, in metres ahead and to the right of the camera."""

    ahead: float  # of the middle
    right: float
    length_ahead: float  # from the middle to the front
    length_right: float
    width_ahead: float  # from the middle to the left side
    width_right: float


@kernel
def new_bodies(count):  # type: ignore[no-untyped-def]
    """Empty Bodies for M = `count`."""
    return Bodies(
        np.zeros(1, np.int64),
        np.zeros(count, np.int64),
        np.zeros((count, POLYGONS, _VERTICES, 2)),
        np.zeros((count, POLYGONS), np.int64),
        np.zeros((count, POLYGONS)),
        np.zeros((count, POLYGONS)),
        np.zeros((count, POLYGONS)),
        np.zeros((count, POLYGONS)),
        np.zeros((count, POLYGONS), np.bool_),
        np.zeros(count, np.int64),
        np.zeros(count),
        np.zeros((PANELS, 5)),
        np.zeros((4, 3)),
    )


@kernel
def place(bodies, objects, i, rows, p, look):  # type: ignore[no-untyped-def]
    """Fill `bodies` with the visible Objects of vehicle i on the lowest `rows` rows, lit by its Look."""
    count = objects.handle.shape[1]
    order, distance = bodies.order, bodies.distance
    found = 0
    for m in range(count):
        if objects.handle[i, m] == _UNUSED or math.isnan(objects.forward_m[i, m]):
            continue
        f, g = objects.forward_m[i, m] - p.forward, objects.left_m[i, m] - p.left
        away = math.sqrt(f * f + g * g)
        ahead, aside = p.cos_yaw * f + p.sin_yaw * g, abs(p.cos_yaw * g - p.sin_yaw * f)
        size = 0.5 * (objects.length_m[i, m] + objects.width_m[i, m]) + 1.0
        # a cone wider than the image of any camera whose principal point is within a quarter of the width
        if ahead + size < 0.0 or aside - size > (ahead + size) * 260.0 / p.focal:
            continue
        at = found
        while at > 0 and distance[at - 1] < away:
            distance[at], order[at] = distance[at - 1], order[at - 1]
            at -= 1
        distance[at], order[at] = away, m
        found += 1
    used = np.int64(0)  # a literal 0 would make another compiled variant
    for at in range(found):
        bodies.polygons[used] = 0
        keep = contrast_left(distance[at], look)
        fall = 1.0 + distance[at] / look.headlight_reach_m
        light = keep * (look.ambient + look.headlight / (fall * fall))
        haze = look.haze_grey * look.ambient * (1.0 - keep)
        _place_body(bodies, used, objects, i, order[at], rows, p, light, haze)
        if bodies.polygons[used] > 0:
            used += 1
    bodies.used[0] = used


@inlined
def _place_body(bodies, b, objects, i, m, rows, p, light, haze):  # type: ignore[no-untyped-def]
    sin_h, cos_h = math.sin(objects.heading_rad[i, m]), math.cos(objects.heading_rad[i, m])
    f, g = objects.forward_m[i, m], objects.left_m[i, m]
    half_l, half_w = 0.5 * objects.length_m[i, m], 0.5 * objects.width_m[i, m]
    height = objects.height_m[i, m]
    handle = objects.handle[i, m]
    # the camera in the body's own frame
    cf = cos_h * (p.forward - f) + sin_h * (p.left - g)
    cl = -sin_h * (p.forward - f) + cos_h * (p.left - g)
    if abs(cf) <= half_l and abs(cl) <= half_w:
        return  # the camera is inside the body
    ahead, right = _on_ground(f - p.forward, g - p.left, p)
    along, aside = _on_ground(cos_h, sin_h, p), _on_ground(-sin_h, cos_h, p)
    reach = 0.15  # of the shadow under a vehicle
    out_l, out_w = half_l + reach, half_w + reach
    shadow = Box(ahead, right, out_l * along[0], out_l * along[1], out_w * aside[0], out_w * aside[1])
    if _out_of_image(shadow, height, rows, p):
        return
    vehicle = handle >= 0
    paint = 35.0 + 190.0 * lattice_unit(handle, 77) if vehicle else 110.0
    if vehicle:
        for q in range(4):
            a, c = 1.0 if q in (0, 3) else -1.0, 1.0 if q in (0, 1) else -1.0
            ahead_q, right_q = _corner_of(shadow, a, c)
            _see(bodies.corner, q, ahead_q, right_q, 0.0, p)
        _polygon(bodies, b, p, _DARK * light + haze, 0.75, False)
    box = Box(ahead, right, half_l * along[0], half_l * along[1], half_w * aside[0], half_w * aside[1])
    for side in range(4):  # rear, front, left, right
        if side == 0 and cf < -half_l:
            a0, c0, a1, c1, tone = -1.0, 1.0, -1.0, -1.0, 1.0
        elif side == 1 and cf > half_l:
            a0, c0, a1, c1, tone = 1.0, -1.0, 1.0, 1.0, 1.0
        elif side == 2 and cl > half_w:
            a0, c0, a1, c1, tone = 1.0, 1.0, -1.0, 1.0, 0.78
        elif side == 3 and cl < -half_w:
            a0, c0, a1, c1, tone = -1.0, -1.0, 1.0, -1.0, 1.12
        else:
            continue
        begin, end = _corner_of(box, a0, c0), _corner_of(box, a1, c1)
        run_ahead, run_right = end[0] - begin[0], end[1] - begin[1]
        top = max(_highest_seen(begin[0], rows, p), _highest_seen(end[0], rows, p))
        panel = bodies.panel
        panels = _panels_of_vehicle(panel, side, height, half_l, tone) if vehicle else 1
        panel[0, 0], panel[0, 1], panel[0, 2], panel[0, 3] = 0.0, 1.0, 0.0, height
        panel[0, 4] = min(paint * tone, 245.0)
        for k in range(panels):
            if panel[k, 2] >= top:
                continue  # above the image
            for q in range(4):
                u, z = panel[k, 0 if q in (0, 3) else 1], panel[k, 2 if q < 2 else 3]
                _see(bodies.corner, q, begin[0] + u * run_ahead, begin[1] + u * run_right, z, p)
            _polygon(bodies, b, p, panel[k, 4] * light + haze, 1.0, k == 0)


@kernel
def _panels_of_vehicle(panel, side, height, half_l, tone):  # type: ignore[no-untyped-def]
    """Fill panel[1:] with the panels on a vehicle's side (0 rear, 1 front, 2 left, 3 right).

    Returns the number of panels, the side itself, panel[0], included. Rows as in Bodies.panel.
    """
    car = height < 2.2 and half_l < 3.5
    glass = 38.0 + 12.0 * tone
    if side > 1:
        wheel, span = min(0.65, 0.3 * height), min(0.65 / (2.0 * half_l), 0.3)
        _put(panel, 1, 0.12, 0.12 + span, 0.0, wheel, _DARK)
        _put(panel, 2, 0.88 - span, 0.88, 0.0, wheel, _DARK)
        _put(panel, 3, 0.2, 0.88, 0.6 * height, 0.9 * height, glass)
        return 4 if car else 3
    lamp, plate = 75.0 if side == 0 else 235.0, 190.0
    low, high = (0.42, 0.54) if car else (0.2, 0.26)
    under, over = (0.3, 0.38) if car else (0.15, 0.19)
    _put(panel, 1, 0.0, 1.0, 0.0, 0.14 * height, _DARK)
    _put(panel, 2, 0.04, 0.16, low * height, high * height, lamp)
    _put(panel, 3, 0.84, 0.96, low * height, high * height, lamp)
    _put(panel, 4, 0.38, 0.62, under * height, over * height, plate)
    _put(panel, 5, 0.1, 0.9, 0.6 * height, 0.9 * height, glass)
    return 6 if car or side == 1 else 5


@kernel
def _put(panel, k, u0, u1, z0, z1, grey):  # type: ignore[no-untyped-def]
    panel[k, 0], panel[k, 1], panel[k, 2], panel[k, 3], panel[k, 4] = u0, u1, z0, z1, grey


@kernel
def _on_ground(forward, left, p):  # type: ignore[no-untyped-def]
    """(ahead, right) in the camera's direction of a ground vector in the vehicle frame."""
    return p.cos_yaw * forward + p.sin_yaw * left, p.sin_yaw * forward - p.cos_yaw * left


@kernel
def _corner_of(box, lengths, widths):  # type: ignore[no-untyped-def]
    """(ahead, right) of the point `lengths` half lengths and `widths` half widths from a Box's middle."""
    return (
        box.ahead + lengths * box.length_ahead + widths * box.width_ahead,
        box.right + lengths * box.length_right + widths * box.width_right,
    )


@kernel
def _highest_seen(ahead, rows, p):  # type: ignore[no-untyped-def]
    """Height above the road (m) that the upper edge of the lowest `rows` rows shows `ahead` metres ahead."""
    t = (rows - 0.5 - p.center_y) / p.focal_y
    return p.height + ahead * (t * p.cos_pitch - p.sin_pitch) / (p.cos_pitch + t * p.sin_pitch)


@kernel
def _out_of_image(box, height, rows, p):  # type: ignore[no-untyped-def]
    """Whether a body is wholly beside or above the image, with no part nearer than _NEAREST_M."""
    left, right, above = True, True, True
    for q in range(4):
        ahead, aside = _corner_of(box, 1.0 if q & 1 else -1.0, 1.0 if q & 2 else -1.0)
        for z in (0.0, height):
            depth = p.cos_pitch * ahead - p.sin_pitch * (z - p.height)
            if depth < _NEAREST_M:
                return False
            left = left and p.focal * aside < -(p.center_x + 1.0) * depth
            right = right and p.focal * aside > (WIDTH_PX - p.center_x) * depth
        above = above and _highest_seen(ahead, rows, p) < 0.0
    return left or right or above


@kernel
def _see(corner, q, ahead, right, up, p):  # type: ignore[no-untyped-def]
    """corner[q] (3,): depth, right and up in the camera frame of a point `up` metres above the road."""
    rise = up - p.height
    corner[q, 0] = p.cos_pitch * ahead - p.sin_pitch * rise
    corner[q, 1] = right
    corner[q, 2] = p.sin_pitch * ahead + p.cos_pitch * rise


@inlined
def _polygon(bodies, b, p, grey, opacity, whole):  # type: ignore[no-untyped-def]
    """Project the quadrilateral bodies.corner, clipped at _NEAREST_M, and append it to body b's polygons."""
    q = bodies.polygons[b]
    if q >= POLYGONS:
        return
    vertex, corner = bodies.vertex[b, q], bodies.corner
    used = np.int64(0)  # a literal 0 would make another compiled variant
    left, right, bottom, top = math.inf, -math.inf, math.inf, -math.inf
    for c in range(4):
        d = (c + 1) % 4
        z0, z1 = corner[c, 0], corner[d, 0]
        for cut in range(2):
            if cut == 0:
                if z0 < _NEAREST_M:
                    continue
                depth, aside, rise = z0, corner[c, 1], corner[c, 2]
            else:
                if (z0 >= _NEAREST_M) == (z1 >= _NEAREST_M):
                    continue
                t = (_NEAREST_M - z0) / (z1 - z0)
                depth = _NEAREST_M
                aside = corner[c, 1] + t * (corner[d, 1] - corner[c, 1])
                rise = corner[c, 2] + t * (corner[d, 2] - corner[c, 2])
            near = 1.0 / depth
            x, y = p.center_x + p.focal * aside * near, p.center_y + p.focal_y * rise * near
            vertex[used, 0], vertex[used, 1] = x, y
            left, right, bottom, top = min(left, x), max(right, x), min(bottom, y), max(top, y)
            used += 1
    if used < 3 or right < -1.0 or left > WIDTH_PX or top < -0.5:
        return
    bodies.vertices[b, q] = used
    bodies.bottom[b, q], bodies.top[b, q] = bottom, top
    bodies.grey[b, q] = grey
    bodies.opacity[b, q] = opacity
    bodies.whole[b, q] = whole
    bodies.polygons[b] = q + 1


@inlined
def paint_bodies(canvas, first, end, bodies):  # type: ignore[no-untyped-def]
    """Paint the bodies on image rows `first` to `end` - 1; the canvas begins with row `first`."""
    for b in range(bodies.used[0]):
        for q in range(bodies.polygons[b]):
            bottom, top = bodies.bottom[b, q], bodies.top[b, q]
            if bottom <= end - 0.5 and top >= first - 0.5:
                vertex, used = bodies.vertex[b, q], bodies.vertices[b, q]
                _paint_polygon(
                    canvas, first, end, vertex, used, bottom, top, bodies.grey[b, q], bodies.opacity[b, q]
                )


@inlined
def hide(column, bodies):  # type: ignore[no-untyped-def]
    """Set column (rows,), a line's column per image row, to NaN where a body (not its shadow) covers it."""
    for b in range(bodies.used[0]):
        for q in range(bodies.polygons[b]):
            if not bodies.whole[b, q]:
                continue
            vertex, used = bodies.vertex[b, q], bodies.vertices[b, q]
            bottom, top = bodies.bottom[b, q], bodies.top[b, q]
            least, most = math.inf, -math.inf
            for c in range(used):
                least, most = min(least, vertex[c, 0]), max(most, vertex[c, 0])
            least, most = least - 1.0, most + 1.0  # so that rounding excludes nothing on an edge
            for y in range(max(math.ceil(bottom), 0), math.floor(min(top, column.shape[0] - 1.0)) + 1):
                if least < column[y] < most:
                    left, right = _span(vertex, used, y)
                    if left <= column[y] <= right:
                        column[y] = math.nan


@inlined
def _span(vertex, used, y):  # type: ignore[no-untyped-def]
    """(left, right) of a convex polygon at height y; left > right above and below it."""
    left, right = math.inf, -math.inf
    for c in range(used):
        d = c + 1 if c + 1 < used else 0
        y0, y1 = vertex[c, 1], vertex[d, 1]
        if (y0 <= y) != (y1 <= y):
            x = vertex[c, 0] + (y - y0) / (y1 - y0) * (vertex[d, 0] - vertex[c, 0])
            left, right = min(left, x), max(right, x)
    return left, right


@inlined
def _paint_polygon(canvas, lowest, end, vertex, used, bottom, top, grey, opacity):  # type: ignore[no-untyped-def]
    """Paint a convex polygon on image rows `lowest` to `end` - 1, by the share of each pixel it covers."""
    grey = np.float32(grey)
    first_row = math.floor(max(bottom, lowest - 0.5) + 0.5)
    for y in range(first_row, math.floor(min(top + 0.5, end - 1.0)) + 1):
        low, high = max(bottom, y - 0.5), min(top, y + 0.5)
        left, right = _span(vertex, used, 0.5 * (low + high))
        left, right = max(left, -1.0), min(right, WIDTH_PX + 0.0)
        if right <= left or high <= low:
            continue
        first, after = whole_vectors(math.floor(left + 0.5), math.floor(right + 0.5) + 1)
        _blend(
            canvas[y - lowest, first:after],
            np.float32(first + 0.5 - left),
            np.float32(right + 0.5 - first),
            np.float32(min(right - left, 1.0)),
            np.float32((high - low) * opacity),
            grey,
        )


@inlined
def _blend(part, from_left, to_right, most, share, grey):  # type: ignore[no-untyped-def]
    """Blend grey into the pixels between two edges, by the share of each that is covered."""
    zero = np.float32(0.0)
    for x in range(part.shape[0]):
        f = np.float32(np.int32(x))
        cover = max(min(min(f + from_left, to_right - f), most), zero)
        part[x] += cover * share * (grey - part[x])
