"""One pass from the bottom row up: ground, markings, light, bodies, sensor."""

import math

import numpy as np

from camera_synth.body_kernels import new_bodies, paint_bodies, place
from camera_synth.condition import look_of
from camera_synth.degrade import NODE_PX, value_noise
from camera_synth.ground_kernels import cross, new_crossings, new_curves, row_line, tabulate
from camera_synth.light_kernels import light
from camera_synth.sensor_kernels import exposure_of, new_sensor, read_out
from camera_synth.surface_kernels import Strip, paint_ground, paint_markings
from sumo_net.compile import kernel


@kernel
def render_fleet(frames, first_row, p, road, objects, x_m, y_m, heading_rad, looks, keys, counters):  # type: ignore[no-untyped-def]
    """Fill frames (n, height, width) uint8 from array row `first_row` down; see render.render."""
    n, height, width = frames.shape
    curves = new_curves(road.forward_m.shape[1])
    crossings = new_crossings(height - first_row)
    bodies = new_bodies(objects.handle.shape[1])
    sensor = new_sensor(height, width)
    row, skyline = np.zeros(width, np.float32), np.zeros(width, np.float32)
    cover, texture = np.zeros(width, np.float32), np.zeros(width, np.float32)
    node = np.zeros(width // NODE_PX + 1, np.float32)
    horizon = p.center_y + p.focal_y * p.sin_pitch / p.cos_pitch
    for i in range(n):
        look = look_of(looks, i)
        tabulate(curves, road, i, p)
        cross(crossings, curves, p)
        place(bodies, objects, i, p, look.ambient, look.haze_grey, look.visibility_m)
        # the camera in the world
        sin_v, cos_v = math.sin(heading_rad[i]), math.cos(heading_rad[i])
        x0 = x_m[i] + cos_v * p.forward - sin_v * p.left
        y0 = y_m[i] + sin_v * p.forward + cos_v * p.left
        sin_c = sin_v * p.cos_yaw + cos_v * p.sin_yaw
        cos_c = cos_v * p.cos_yaw - sin_v * p.sin_yaw
        exposure = exposure_of(look, sin_c, cos_c, horizon, p, keys[i], counters[i])
        if height - first_row > horizon:
            _trace_skyline(skyline, sin_c, cos_c, p, look.world_seed)
        for y in range(height - first_row):
            if y + 0.5 < horizon:
                strip = _strip(y, crossings.ahead[y + 1] - crossings.ahead[y], x0, y0, sin_c, cos_c, p)
                paint_ground(row, cover, texture, node, y, crossings, look, strip)
                paint_markings(row, y, crossings, look, strip)
                light(row, cover, node, y, crossings, look, strip)
            else:
                _paint_sky(row, y - horizon, skyline, look)
            paint_bodies(row, y, bodies)
            read_out(frames[i, height - 1 - y], row, y, sensor, exposure, keys[i], counters[i])


@kernel
def _strip(y, footprint, x0, y0, sin_c, cos_c, p):  # type: ignore[no-untyped-def]
    """The Strip of row y for a camera at (x0, y0) that looks along (cos_c, sin_c) in the world."""
    ahead, depth = row_line(y, p)
    aside, step = p.center_x * depth / p.focal, -depth / p.focal
    x, y = x0 + cos_c * ahead - sin_c * aside, y0 + sin_c * ahead + cos_c * aside
    return Strip(ahead, footprint, aside, step, x, y, -sin_c * step, cos_c * step)


@kernel
def _trace_skyline(skyline, sin_c, cos_c, p, seed):  # type: ignore[no-untyped-def]
    """Height of the trees above the horizon in each column, the same in each direction of the world."""
    for x in range(skyline.shape[0]):
        aside = (p.center_x - x) / p.focal
        dx, dy = cos_c - sin_c * aside, sin_c + cos_c * aside
        low = value_noise(12.0 * dx, 12.0 * dy, seed + 51)
        skyline[x] = 5.0 + 5.0 * low + 2.0 * value_noise(150.0 * dx, 150.0 * dy, seed + 52)


@kernel
def _paint_sky(row, rise, skyline, look):  # type: ignore[no-untyped-def]
    ambient = look.ambient
    hazy = 4.0 / (8.0 + max(rise, 0.0))
    sky = np.float32(look.sky_grey * (1.0 - hazy) + look.haze_grey * ambient * hazy)
    trees = np.float32((0.6 * look.verge_grey + 0.3 * look.haze_grey) * ambient)
    zero, one = np.float32(0.0), np.float32(1.0)
    above = np.float32(rise - 0.5)
    for x in range(row.shape[0]):
        cover = min(max(skyline[x] - above, zero), one)
        row[x] = sky + (trees - sky) * cover
