"""The layers of a frame in order: ground, markings, light, sky, bodies, sensor."""

import math

import numpy as np

from camera_synth.body_kernels import new_bodies, paint_bodies, place
from camera_synth.condition import look_of
from camera_synth.degrade import contrast_left, value_noise
from camera_synth.ground_kernels import cross, lay, new_crossings, new_curves, tabulate
from camera_synth.light_kernels import cast_light, light_ground
from camera_synth.pattern_kernels import ROOM, ground_of
from camera_synth.sensor_kernels import exposure_of, new_lens, read_out
from camera_synth.surface_kernels import (
    paint_ground,
    paint_markings,
    paint_tracks,
    texture_ground,
    view_of,
)
from camera_synth.truth_kernels import locate
from sumo_net.compile import kernel

_TREES_M = 400.0  # distance of the skyline
BLOCK_ROWS = 16  # painted layer by layer: the canvas, 20 KB, stays in the first-level cache


@kernel
def render_fleet(frames, first_row, p, road, objects, x_m, y_m, heading_rad, looks, keys, counters, truth):  # type: ignore[no-untyped-def]
    """Fill frames (n, height, width) uint8 from array row `first_row` down; see render.render.

    truth: right slots (n,) and BorderColumns of n vehicles, filled too; of 0 vehicles if not wanted.
    """
    n, height, width = frames.shape
    rows = height - first_row
    horizon = p.center_y + p.focal_y * p.sin_pitch / p.cos_pitch
    ground = min(max(math.ceil(horizon - 0.5), 0), rows)  # rows that show nothing but ground
    curves = new_curves(road.forward_m.shape[1])
    crossings = new_crossings(rows)
    bodies = new_bodies(objects.handle.shape[1])
    canvas, lens = np.empty((BLOCK_ROWS, width), np.float32), new_lens(height)
    slot, borders = truth
    judged = borders.column.shape[0] == n
    seen_rows = max(rows, borders.column.shape[2])
    middles = new_crossings(borders.column.shape[2] - 1)
    lay(crossings, -0.5, p)
    lay(middles, 0.0, p)
    pixels, skyline = np.zeros(width, np.float32), np.zeros(width, np.float32)
    texture, light = np.zeros((rows, ROOM), np.float32), np.zeros((rows, ROOM), np.float32)
    strips = ground_of(ground, p)
    for i in range(n):
        look = look_of(looks, i)
        view = view_of(x_m[i], y_m[i], heading_rad[i], p)
        tabulate(curves, road, i, p)
        cross(crossings, curves, p)
        texture_ground(texture, ground, strips, look, view, p)
        uneven = cast_light(light, ground, strips, crossings, look, view, p)
        place(bodies, objects, i, seen_rows, p, look)
        if judged:
            column, painted = borders.column[i], borders.painted[i]
            locate(column, painted, width, p, curves, middles, bodies, slot[i], look, view)
        exposure = exposure_of(look, view.sin, view.cos, horizon, p, keys[i], counters[i])
        if rows > ground:
            _trace_skyline(skyline, view, p, look.world_seed)
        for first in range(0, rows, BLOCK_ROWS):
            end = min(first + BLOCK_ROWS, rows)
            paved = min(end, ground)
            paint_ground(canvas, texture, first, paved, pixels, crossings, look)
            if look.wheel_tracks > 0.0:
                paint_tracks(canvas, first, paved, crossings, look)
            paint_markings(canvas, first, paved, crossings, look, view, p)
            light_ground(canvas, light, uneven, first, paved, pixels, crossings, look)
            for y in range(max(first, ground), end):
                _paint_sky(canvas[y - first], y - horizon, skyline, look)
            paint_bodies(canvas, first, end, bodies)
            read_out(frames[i], canvas, first, end, lens, exposure, keys[i], counters[i])


@kernel
def _trace_skyline(skyline, view, p, seed):  # type: ignore[no-untyped-def]
    """Height of the trees above the horizon in each column, a function of the world direction."""
    for x in range(skyline.shape[0]):
        aside = (p.center_x - x) / p.focal
        dx, dy = view.cos - view.sin * aside, view.sin + view.cos * aside
        low = value_noise(12.0 * dx, 12.0 * dy, seed + 51)
        skyline[x] = 5.0 + 5.0 * low + 2.0 * value_noise(150.0 * dx, 150.0 * dy, seed + 52)


@kernel
def _paint_sky(row, rise, skyline, look):  # type: ignore[no-untyped-def]
    ambient = look.ambient
    hazy = 4.0 / (8.0 + max(rise, 0.0))
    sky = np.float32(look.sky_grey * (1.0 - hazy) + look.haze_grey * ambient * hazy)
    keep = contrast_left(_TREES_M, look)
    trees = np.float32((look.verge_grey * keep + look.haze_grey * (1.0 - keep)) * ambient)
    zero, one = np.float32(0.0), np.float32(1.0)
    above = np.float32(rise - 0.5)
    for x in range(row.shape[0]):
        cover = min(max(skyline[x] - above, zero), one)
        row[x] = sky + (trees - sky) * cover
