"""One pass from the bottom row up: ground, markings, light, bodies, sensor."""

import math

import numpy as np

from camera_synth.body_kernels import new_bodies, paint_bodies, place
from camera_synth.degrade import NODE_PX, expose, interpolate, smooth_walk, value_noise
from camera_synth.ground_kernels import CURVES, cross, new_crossings, new_curves, row_line, tabulate
from camera_synth.light_kernels import light
from camera_synth.surface_kernels import Strip, paint_ground, paint_markings
from sumo_net.compile import kernel

_VEIL_GREY = 235.0


@kernel
def render_fleet(frames, first_row, p, road, objects, x_m, y_m, heading_rad, looks, keys, counters):  # type: ignore[no-untyped-def]
    """Fill frames (n, height, width) uint8 from array row `first_row` down; see render.render."""
    n, height, width = frames.shape
    nodes = width // NODE_PX + 1
    samples = road.forward_m.shape[1]
    curves = new_curves(samples)
    lower, upper = new_crossings(), new_crossings()
    bodies = new_bodies(objects.handle.shape[1])
    row, wide = np.zeros(width, np.float32), np.zeros(width, np.float32)
    cover, texture = np.zeros(width, np.float32), np.zeros(width, np.float32)
    gain, black = np.zeros(width, np.float32), np.zeros(width, np.float32)
    node = np.zeros(nodes, np.float32)
    radial, skyline = np.zeros(width, np.float32), np.zeros(width, np.float32)
    for x in range(width):
        radial[x] = ((x - 0.5 * width) ** 2) / (0.25 * (width**2 + height**2))
    for i in range(n):
        tabulate(curves, road, i, p)
        ambient = looks.ambient[i]
        place(bodies, objects, i, p, ambient, looks.haze_grey[i], looks.visibility_m[i])
        # the camera in the world
        sin_v, cos_v = math.sin(heading_rad[i]), math.cos(heading_rad[i])
        camera_x = x_m[i] + cos_v * p.forward - sin_v * p.left
        camera_y = y_m[i] + sin_v * p.forward + cos_v * p.left
        sin_c = sin_v * p.cos_yaw + cos_v * p.sin_yaw
        cos_c = cos_v * p.cos_yaw - sin_v * p.sin_yaw
        # slow changes of the exposure, a function of the frame's number
        time = counters[i] / looks.drift_frames[i]
        exposure = 1.0 + looks.drift[i] * smooth_walk(keys[i] ^ np.uint64(0x5EED), time)
        offset = looks.drift_grey[i] * smooth_walk(keys[i] ^ np.uint64(0xB1AC), time)
        # the sun in the image
        sun_sin = math.sin(looks.sun_azimuth_rad[i]) * cos_c - math.cos(looks.sun_azimuth_rad[i]) * sin_c
        sun_cos = math.cos(looks.sun_azimuth_rad[i]) * cos_c + math.sin(looks.sun_azimuth_rad[i]) * sin_c
        glare = looks.glare[i] * max(0.0, sun_cos) ** 2
        sun_x = p.center_x - p.focal * sun_sin / max(sun_cos, 0.2)
        horizon = p.center_y + p.focal_y * p.sin_pitch / p.cos_pitch
        sun_y = horizon + 0.15 * p.focal_y
        wide[:] = 0.0  # the veil
        if first_row < height - 1 - horizon:
            _trace_skyline(skyline, sin_c, cos_c, p, looks.world_seed[i])
        for k in range(CURVES):
            lower.piece[k] = 0
        _cross_row(curves, lower, -0.5, p)
        bottom, _ = row_line(-0.5, p)
        for y in range(height - first_row):
            if y + 0.5 < horizon:
                for k in range(CURVES):
                    upper.piece[k] = lower.piece[k]
                top, depth_top = row_line(y + 0.5, p)
                cross(curves, upper, top, depth_top, p)
                ahead, depth = row_line(y, p)
                # the world under the row: a line, linear in the column
                aside = p.center_x * depth / p.focal
                step = -depth / p.focal
                wx, wy = camera_x + cos_c * ahead - sin_c * aside, camera_y + sin_c * ahead + cos_c * aside
                strip = Strip(ahead, top - bottom, aside, step, wx, wy, -sin_c * step, cos_c * step)
                paint_ground(row, cover, texture, node, lower, upper, looks, i, strip)
                paint_markings(row, lower, upper, looks, i, strip)
                light(row, cover, node, lower, upper, looks, i, strip)
                lower, upper = upper, lower
                bottom = top
            else:
                _paint_sky(row, y - horizon, skyline, looks, i)
            paint_bodies(row, y, bodies)
            if glare > 0.0:
                rise = (y - sun_y) ** 2
                for m in range(nodes):
                    away = (NODE_PX * m - sun_x) ** 2 + rise
                    node[m] = glare * (0.45 + 0.55 / (1.0 + away / 19600.0))
                interpolate(node, wide)
            vignetting = np.float32(looks.vignetting[i])
            centre = np.float32((y - 0.5 * height) ** 2 / (0.25 * (width**2 + height**2)))
            scale, floor = np.float32(exposure), np.float32(offset)
            one, veil_grey = np.float32(1.0), np.float32(_VEIL_GREY)
            for x in range(width):
                gain[x] = scale * (one - vignetting * (radial[x] + centre)) * (one - wide[x])
                black[x] = floor + veil_grey * wide[x]
            draw = np.uint64(counters[i]) * np.uint64(height) + np.uint64(y)
            expose(frames[i, height - 1 - y], row, gain, black, looks.noise_grey[i], keys[i], draw)


@kernel
def _cross_row(curves, crossings, y, p):  # type: ignore[no-untyped-def]
    ahead, depth = row_line(y, p)
    cross(curves, crossings, ahead, depth, p)


@kernel
def _trace_skyline(skyline, sin_c, cos_c, p, seed):  # type: ignore[no-untyped-def]
    """Height of the trees above the horizon in each column, the same in each direction of the world."""
    for x in range(skyline.shape[0]):
        aside = (p.center_x - x) / p.focal
        dx, dy = cos_c - sin_c * aside, sin_c + cos_c * aside
        low = value_noise(12.0 * dx, 12.0 * dy, seed + 51)
        skyline[x] = 5.0 + 5.0 * low + 2.0 * value_noise(150.0 * dx, 150.0 * dy, seed + 52)


@kernel
def _paint_sky(row, rise, skyline, looks, i):  # type: ignore[no-untyped-def]
    ambient = looks.ambient[i]
    hazy = 4.0 / (8.0 + max(rise, 0.0))
    sky = np.float32(looks.sky_grey[i] * (1.0 - hazy) + looks.haze_grey[i] * ambient * hazy)
    trees = np.float32((0.6 * looks.verge_grey[i] + 0.3 * looks.haze_grey[i]) * ambient)
    zero, one = np.float32(0.0), np.float32(1.0)
    above = np.float32(rise - 0.5)
    for x in range(row.shape[0]):
        cover = min(max(skyline[x] - above, zero), one)
        row[x] = sky + (trees - sky) * cover
