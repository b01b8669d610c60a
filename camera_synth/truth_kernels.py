"""True positions of the ego lane's borders in the image, and where a body hides them."""

import math

from camera_synth.body_kernels import hide, new_bodies, place
from camera_synth.condition import look_of
from camera_synth.ground_kernels import cross_curve, lay, new_crossings, new_curves, tabulate
from camera_synth.surface_kernels import paint_left, strip_of, view_of
from sumo_net.compile import kernel
from sumo_net.road import MAX_BORDERS, SOLID

LEAST_PAINT = 0.25  # share of a new marking's paint below which nothing can be seen


@kernel
def locate_borders(column, painted, width, p, road, objects, right_slot, looks, x_m, y_m, heading_rad):  # type: ignore[no-untyped-def]
    """Fill column, painted (n, 2, rows); see truth.border_columns."""
    n, _, rows = column.shape
    curves, middles = new_curves(road.forward_m.shape[1]), new_crossings(rows - 1)
    bodies = new_bodies(objects.handle.shape[1])
    lay(middles, 0.0, p)
    for i in range(n):
        look = look_of(looks, i)
        tabulate(curves, road, i, p)
        place(bodies, objects, i, rows, p, look)
        view = view_of(x_m[i], y_m[i], heading_rad[i], p)
        locate(column[i], painted[i], width, p, curves, middles, bodies, right_slot[i], look, view)


@kernel
def locate(column, painted, width, p, curves, middles, bodies, right_slot, look, view):  # type: ignore[no-untyped-def]
    """Fill column, painted (2, rows) of one vehicle from its `curves` and placed `bodies`.

    middles: Crossings at the rows' centres (`lay` from 0.0 on).
    """
    rows = column.shape[1]
    worn = look.wear > 0.0 or look.missing > 0.0
    period = look.dash_stroke_m + look.dash_gap_m
    for side in range(2):
        slot = right_slot + 1 - side
        column[side, :] = math.nan
        painted[side, :] = False
        if not 0 <= slot < MAX_BORDERS:
            continue
        cross_curve(middles, curves, slot, p)
        for y in range(rows):
            x = middles.column[slot, y]
            if middles.kind[slot, y] != 0 and -0.5 <= x <= width - 0.5:
                column[side, y] = x
        hide(column[side], bodies)
        for y in range(rows):
            x = column[side, y]
            if math.isnan(x):
                continue
            station = middles.station[slot, y]
            solid = middles.kind[slot, y] == SOLID
            shown = solid or station - math.floor(station / period) * period < look.dash_stroke_m
            if shown and worn:
                footprint = middles.ahead[min(y + 1, rows - 1)] - middles.ahead[max(y - 1, 0)]
                strip = strip_of(y, 0.5 * footprint, view, p)
                left = paint_left(look, strip.x + x * strip.dx, strip.y + x * strip.dy, strip.footprint)
                shown = left >= LEAST_PAINT
            painted[side, y] = shown
