"""Bodies as boxes: the faces that the camera sees, as polygons in the image, far ones first."""

import math
from typing import Any, NamedTuple

import numpy as np

from camera_synth.camera import WIDTH_PX
from camera_synth.degrade import lattice_unit
from sumo_net.compile import kernel

Array = np.ndarray[Any, Any]

POLYGONS = 20  # at most for one body
_VERTICES = 6
_NEAREST_M = 0.3  # depth at which faces are cut off
_UNUSED = -1


class Bodies(NamedTuple):
    """Scratch for one vehicle: what it sees of the bodies around it, in painter's order."""

    used: Array  # (1,) int64, bodies in view
    polygons: Array  # (M,) int64, of each
    vertex: Array  # (M, POLYGONS, _VERTICES, 2)
    vertices: Array  # (M, POLYGONS) int64
    grey: Array  # (M, POLYGONS)
    opacity: Array  # (M, POLYGONS)
    order: Array  # (M,) int64
    distance: Array  # (M,) m
    corner: Array  # (4, 3) of a face, vehicle frame
    camera: Array  # (4, 3) the same for the camera: depth, to the right, up


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
        np.zeros(count, np.int64),
        np.zeros(count),
        np.zeros((4, 3)),
        np.zeros((4, 3)),
    )


@kernel
def place(bodies, objects, i, p, look):  # type: ignore[no-untyped-def]
    """Fill `bodies` with what vehicle i sees of its Objects in the light of its Look."""
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
        # a cone somewhat wider than any camera's image that is centred within a quarter of its width
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
        keep = look.visibility_m / (look.visibility_m + distance[at])
        fall = 1.0 + distance[at] / look.headlight_reach_m
        light = keep * (look.ambient + look.headlight / (fall * fall))
        haze = look.haze_grey * look.ambient * (1.0 - keep)
        _place_body(bodies, used, objects, i, order[at], p, light, haze)
        if bodies.polygons[used] > 0:
            used += 1
    bodies.used[0] = used


@kernel
def _place_body(bodies, b, objects, i, m, p, light, haze):  # type: ignore[no-untyped-def]
    sin_h, cos_h = math.sin(objects.heading_rad[i, m]), math.cos(objects.heading_rad[i, m])
    f, g = objects.forward_m[i, m], objects.left_m[i, m]
    half_l, half_w = 0.5 * objects.length_m[i, m], 0.5 * objects.width_m[i, m]
    height = objects.height_m[i, m]
    handle = objects.handle[i, m]
    vehicle = handle >= 0
    car = vehicle and height < 2.2 and half_l < 3.5
    paint = 35.0 + 190.0 * lattice_unit(handle, 77) if vehicle else 110.0
    dark = 22.0
    # the camera in the body's own frame
    cf = cos_h * (p.forward - f) + sin_h * (p.left - g)
    cl = -sin_h * (p.forward - f) + cos_h * (p.left - g)
    if abs(cf) <= half_l and abs(cl) <= half_w:
        return  # the camera would sit inside
    corner = bodies.corner
    reach = 0.15  # of the shadow under a vehicle
    if _beside_image(bodies.camera, f, g, sin_h, cos_h, half_l + reach, half_w + reach, height, p):
        return
    if vehicle:
        for q in range(4):
            a = half_l + reach if q in (0, 3) else -half_l - reach
            c = half_w + reach if q in (0, 1) else -half_w - reach
            corner[q, 0], corner[q, 1], corner[q, 2] = (
                f + a * cos_h - c * sin_h,
                g + a * sin_h + c * cos_h,
                0.0,
            )
        _polygon(bodies, b, corner, p, dark * light + haze, 0.75)
    for side in range(4):  # rear, front, left, right
        if side == 0 and cf < -half_l:
            a0, c0, a1, c1, tone = -half_l, half_w, -half_l, -half_w, 1.0
        elif side == 1 and cf > half_l:
            a0, c0, a1, c1, tone = half_l, -half_w, half_l, half_w, 1.0
        elif side == 2 and cl > half_w:
            a0, c0, a1, c1, tone = half_l, half_w, -half_l, half_w, 0.78
        elif side == 3 and cl < -half_w:
            a0, c0, a1, c1, tone = -half_l, -half_w, half_l, -half_w, 1.12
        else:
            continue
        x0, y0 = f + a0 * cos_h - c0 * sin_h, g + a0 * sin_h + c0 * cos_h
        x1, y1 = f + a1 * cos_h - c1 * sin_h, g + a1 * sin_h + c1 * cos_h
        body = min(paint * tone, 245.0) * light + haze
        glass, tyre = (38.0 + 12.0 * tone) * light + haze, dark * light + haze
        _panel(bodies, b, corner, p, x0, y0, x1, y1, 0.0, 1.0, 0.0, height, body, 1.0)
        if not vehicle:
            continue
        if side <= 1:
            _panel(bodies, b, corner, p, x0, y0, x1, y1, 0.0, 1.0, 0.0, 0.14 * height, tyre, 1.0)
            if car or side == 1:
                _panel(bodies, b, corner, p, x0, y0, x1, y1, 0.1, 0.9, 0.6 * height, 0.9 * height, glass, 1.0)
            lamp = (75.0 if side == 0 else 235.0) * light + haze
            low, high = (0.42, 0.54) if car else (0.2, 0.26)
            _panel(bodies, b, corner, p, x0, y0, x1, y1, 0.04, 0.16, low * height, high * height, lamp, 1.0)
            _panel(bodies, b, corner, p, x0, y0, x1, y1, 0.84, 0.96, low * height, high * height, lamp, 1.0)
            plate = 190.0 * light + haze
            low, high = (0.3, 0.38) if car else (0.15, 0.19)
            _panel(bodies, b, corner, p, x0, y0, x1, y1, 0.38, 0.62, low * height, high * height, plate, 1.0)
        else:
            if car:
                _panel(
                    bodies, b, corner, p, x0, y0, x1, y1, 0.2, 0.88, 0.6 * height, 0.9 * height, glass, 1.0
                )
            wheel = min(0.65, 0.3 * height)
            span = min(0.65 / (2.0 * half_l), 0.3)
            for at in (0.12, 0.88 - span):
                _panel(bodies, b, corner, p, x0, y0, x1, y1, at, at + span, 0.0, wheel, tyre, 1.0)


@kernel
def _beside_image(camera, f, g, sin_h, cos_h, half_l, half_w, height, p):  # type: ignore[no-untyped-def]
    """Whether a box is wholly left or right of the image, and no part of it near the camera's own place."""
    leftmost, rightmost = math.inf, -math.inf
    for q in range(8):
        a = half_l if q & 1 else -half_l
        c = half_w if q & 2 else -half_w
        z = height if q & 4 else 0.0
        _seen_from(camera[0], f + a * cos_h - c * sin_h, g + a * sin_h + c * cos_h, z, p)
        if camera[0, 0] < _NEAREST_M:
            return False
        column = p.center_x + p.focal * camera[0, 1] / camera[0, 0]
        leftmost, rightmost = min(leftmost, column), max(rightmost, column)
    return rightmost < -1.0 or leftmost > WIDTH_PX


@kernel
def _seen_from(out, forward, left, up, p):  # type: ignore[no-untyped-def]
    """out (3,): depth, to the right and up of a point in the vehicle frame, for the camera."""
    f, g, u = forward - p.forward, left - p.left, up - p.height
    ahead = p.cos_yaw * f + p.sin_yaw * g
    out[0] = p.cos_pitch * ahead - p.sin_pitch * u
    out[1] = p.sin_yaw * f - p.cos_yaw * g
    out[2] = p.sin_pitch * ahead + p.cos_pitch * u


@kernel
def _panel(bodies, b, corner, p, x0, y0, x1, y1, u0, u1, z0, z1, grey, opacity):  # type: ignore[no-untyped-def]
    """A part of an upright face over the ground line (x0, y0) -> (x1, y1): shares u of it, heights z."""
    for q in range(4):
        u = u0 if q in (0, 3) else u1
        corner[q, 0] = x0 + u * (x1 - x0)
        corner[q, 1] = y0 + u * (y1 - y0)
        corner[q, 2] = z0 if q < 2 else z1
    _polygon(bodies, b, corner, p, grey, opacity)


@kernel
def _polygon(bodies, b, corner, p, grey, opacity):  # type: ignore[no-untyped-def]
    """Project a quadrilateral (4, 3) in the vehicle frame, cut at the nearest depth, and keep it."""
    q = bodies.polygons[b]
    if q >= POLYGONS:
        return
    vertex = bodies.vertex[b, q]
    camera = bodies.camera
    for c in range(4):
        _seen_from(camera[c], corner[c, 0], corner[c, 1], corner[c, 2], p)
    used = np.int64(0)  # a literal 0 would make another compiled variant
    for c in range(4):
        d = (c + 1) % 4
        z0, z1 = camera[c, 0], camera[d, 0]
        if z0 >= _NEAREST_M:
            vertex[used, 0] = p.center_x + p.focal * camera[c, 1] / z0
            vertex[used, 1] = p.center_y + p.focal_y * camera[c, 2] / z0
            used += 1
        if (z0 >= _NEAREST_M) != (z1 >= _NEAREST_M):
            t = (_NEAREST_M - z0) / (z1 - z0)
            aside = camera[c, 1] + t * (camera[d, 1] - camera[c, 1])
            rise = camera[c, 2] + t * (camera[d, 2] - camera[c, 2])
            vertex[used, 0] = p.center_x + p.focal * aside / _NEAREST_M
            vertex[used, 1] = p.center_y + p.focal_y * rise / _NEAREST_M
            used += 1
    if used < 3:
        return
    left, right, top = math.inf, -math.inf, -math.inf
    for c in range(used):
        left, right = min(left, vertex[c, 0]), max(right, vertex[c, 0])
        top = max(top, vertex[c, 1])
    if right < -1.0 or left > WIDTH_PX or top < -0.5:
        return
    bodies.vertices[b, q] = used
    bodies.grey[b, q] = grey
    bodies.opacity[b, q] = opacity
    bodies.polygons[b] = q + 1


@kernel
def paint_bodies(canvas, bodies):  # type: ignore[no-untyped-def]
    """Paint the bodies on the canvas (rows, width) float32, image row y in its row y."""
    for b in range(bodies.used[0]):
        for q in range(bodies.polygons[b]):
            _paint_polygon(
                canvas, bodies.vertex[b, q], bodies.vertices[b, q], bodies.grey[b, q], bodies.opacity[b, q]
            )


@kernel
def frame_bodies(bodies, boxes):  # type: ignore[no-untyped-def]
    """Fill boxes (bodies, 4) with the bodies' (left, right, bottom, top) in the image, shadows apart."""
    for b in range(bodies.used[0]):
        boxes[b, 0], boxes[b, 1], boxes[b, 2], boxes[b, 3] = math.inf, -math.inf, math.inf, -math.inf
        for q in range(bodies.polygons[b]):
            if bodies.opacity[b, q] < 1.0:
                continue
            for c in range(bodies.vertices[b, q]):
                x, y = bodies.vertex[b, q, c, 0], bodies.vertex[b, q, c, 1]
                boxes[b, 0], boxes[b, 1] = min(boxes[b, 0], x), max(boxes[b, 1], x)
                boxes[b, 2], boxes[b, 3] = min(boxes[b, 2], y), max(boxes[b, 3], y)


@kernel
def hides(bodies, boxes, x, y):  # type: ignore[no-untyped-def]
    """Whether a body (not its shadow) covers the image point; boxes from `frame_bodies`."""
    for b in range(bodies.used[0]):
        if not (boxes[b, 0] <= x <= boxes[b, 1] and boxes[b, 2] <= y <= boxes[b, 3]):
            continue
        for q in range(bodies.polygons[b]):
            if bodies.opacity[b, q] < 1.0:
                continue
            left, right = _span(bodies.vertex[b, q], bodies.vertices[b, q], y)
            if left <= x <= right:
                return True
    return False


@kernel
def _span(vertex, used, y):  # type: ignore[no-untyped-def]
    """(left, right) of a convex polygon at height y; left > right where it does not reach."""
    left, right = math.inf, -math.inf
    for c in range(used):
        d = c + 1 if c + 1 < used else 0
        y0, y1 = vertex[c, 1], vertex[d, 1]
        if (y0 <= y) != (y1 <= y):
            x = vertex[c, 0] + (y - y0) / (y1 - y0) * (vertex[d, 0] - vertex[c, 0])
            left, right = min(left, x), max(right, x)
    return left, right


@kernel
def _paint_polygon(canvas, vertex, used, grey, opacity):  # type: ignore[no-untyped-def]
    """A convex polygon, by the share of each pixel that it covers."""
    rows, width = canvas.shape
    bottom, top = math.inf, -math.inf
    for c in range(used):
        bottom, top = min(bottom, vertex[c, 1]), max(top, vertex[c, 1])
    grey = np.float32(grey)
    first_row, last_row = max(math.floor(max(bottom, -1.0) + 0.5), 0), min(top + 0.5, rows - 1.0)
    for y in range(first_row, math.floor(last_row) + 1):
        low, high = max(bottom, y - 0.5), min(top, y + 0.5)
        left, right = _span(vertex, used, 0.5 * (low + high))
        left, right = max(left, -1.0), min(right, width + 0.0)
        if right <= left or high <= low:
            continue
        first, last = max(math.floor(left + 0.5), 0), min(math.floor(right + 0.5), width - 1)
        _blend(
            canvas[y, first : last + 1],
            np.float32(first + 0.5 - left),
            np.float32(right + 0.5 - first),
            np.float32(min(right - left, 1.0)),
            np.float32((high - low) * opacity),
            grey,
        )


@kernel
def _blend(part, from_left, to_right, most, share, grey):  # type: ignore[no-untyped-def]
    """Blend grey into the pixels between two edges, by what they cover of each."""
    for x in range(part.shape[0]):
        f = np.float32(np.int32(x))
        cover = min(min(f + from_left, to_right - f), most)
        part[x] += cover * share * (grey - part[x])
