"""Asphalt, verge and paint of one image row, before any light falls on it."""

import math
from typing import NamedTuple

import numpy as np

from camera_synth.degrade import NODE_PX, add_value_noise, fade, interpolate, soft_step, value_noise
from camera_synth.ground_kernels import LEFT_EDGE, RIGHT_EDGE, cover_between, paint_band, paint_dashes
from sumo_net.compile import kernel
from sumo_net.road import DASHED, MAX_BORDERS

_FAR = 1.0e6  # columns; stands for an edge outside the image


class Strip(NamedTuple):
    """The ground that an image row shows: a line across the camera's direction, linear in the column."""

    ahead: float  # m from the camera
    footprint: float  # m of ahead that the row spans
    aside: float  # m left of the camera at column 0
    step: float  # m left per column
    x: float  # m, world, at column 0
    y: float
    dx: float  # m per column
    dy: float


@kernel
def paint_ground(row, cover, texture, node, lower, upper, looks, i, strip):  # type: ignore[no-untyped-def]
    """Asphalt between its edges and verge beside it, with the texture of both."""
    right = lower.kind[RIGHT_EDGE] != 0 and upper.kind[RIGHT_EDGE] != 0
    left = lower.kind[LEFT_EDGE] != 0 and upper.kind[LEFT_EDGE] != 0
    if right or left:  # where one edge has turned away before the other, asphalt fills its side
        l0 = lower.column[LEFT_EDGE] if left else -_FAR
        l1 = upper.column[LEFT_EDGE] if left else -_FAR
        r0 = lower.column[RIGHT_EDGE] if right else _FAR
        r1 = upper.column[RIGHT_EDGE] if right else _FAR
        cover_between(cover, l0, l1, r0, r1)
    else:
        cover[:] = 0.0
    seed = looks.world_seed[i]
    strength = looks.texture[i]
    active = False
    if strength > 0.0:
        for octave in range(3):
            wavelength = 0.4 * 4.0**octave
            amplitude = fade(wavelength, strip.footprint)
            if amplitude > 0.0:
                if not active:
                    node[:] = 0.0
                    active = True
                f = 1.0 / wavelength
                add_value_noise(
                    node,
                    strip.x * f,
                    strip.y * f,
                    NODE_PX * strip.dx * f,
                    NODE_PX * strip.dy * f,
                    seed + 11 + octave,
                    amplitude,
                )
    verge = np.float32(looks.verge_grey[i])
    rise = np.float32(looks.asphalt_grey[i]) - verge
    if active:
        interpolate(node, texture)
        rough = np.float32(strength * 2.0)
        less = np.float32(strength) - rough
        for x in range(row.shape[0]):
            row[x] = verge + rise * cover[x] + texture[x] * (rough + less * cover[x])
    else:
        for x in range(row.shape[0]):
            row[x] = verge + rise * cover[x]
    if looks.wheel_tracks[i] > 0.0:
        for k in range(MAX_BORDERS - 1):
            if (
                lower.kind[k] != 0
                and lower.kind[k + 1] != 0
                and upper.kind[k] != 0
                and upper.kind[k + 1] != 0
            ):
                a = 0.5 * (lower.column[k] + upper.column[k])
                span = 0.5 * (lower.column[k + 1] + upper.column[k + 1]) - a
                _paint_track(row, a + 0.3 * span, 0.13 * abs(span), looks.wheel_tracks[i])
                _paint_track(row, a + 0.7 * span, 0.13 * abs(span), looks.wheel_tracks[i])


@kernel
def _paint_track(row, centre, half, grey):  # type: ignore[no-untyped-def]
    if half < 1.5:
        return
    first = min(max(math.ceil(centre - half), 0), row.shape[0])
    end = min(max(math.floor(centre + half) + 1, 0), row.shape[0])
    c, scale, depth, one = np.float32(centre), np.float32(1.0 / half), np.float32(grey), np.float32(1.0)
    for x in range(first, end):
        t = (np.float32(x) - c) * scale
        t = one - t * t
        row[x] -= depth * t * t


@kernel
def paint_markings(row, lower, upper, looks, i, strip):  # type: ignore[no-untyped-def]
    stroke = looks.dash_stroke_m[i]
    period = stroke + looks.dash_gap_m[i]
    first, last = MAX_BORDERS, -1
    for k in range(MAX_BORDERS):
        if lower.kind[k] != 0:
            first, last = min(first, k), k
    for k in range(first, last + 1):
        if lower.kind[k] == 0 or upper.kind[k] == 0:
            continue
        line = looks.edge_width_m[i] if k in (first, last) else looks.marking_width_m[i]
        h0, h1 = 0.5 * line * lower.scale[k], 0.5 * line * upper.scale[k]
        c0, c1 = lower.column[k], upper.column[k]
        if max(c0 + h0, c1 + h1) < -1.0 or min(c0 - h0, c1 - h1) > row.shape[0]:
            continue
        opacity = 1.0
        if looks.wear[i] > 0.0 or looks.missing[i] > 0.0:
            column = 0.5 * (c0 + c1)
            opacity = _paint_left(
                looks, i, strip.x + column * strip.dx, strip.y + column * strip.dy, strip.footprint
            )
        grey = looks.paint_grey[i]
        if lower.kind[k] == DASHED:
            paint_dashes(
                row,
                c0 - h0,
                c1 - h1,
                c0 + h0,
                c1 + h1,
                lower.station[k],
                upper.station[k],
                stroke,
                period,
                grey,
                opacity,
            )
        else:
            paint_band(row, c0 - h0, c1 - h1, c0 + h0, c1 + h1, grey, opacity)


@kernel
def _paint_left(looks, i, x, y, footprint):  # type: ignore[no-untyped-def]
    """Opacity of the paint at a place in the world."""
    seed, wear = looks.world_seed[i], looks.wear[i]
    opacity = 1.0
    if wear > 0.0:
        patch = 0.6 * value_noise(x / 9.0, y / 9.0, seed + 21)
        amplitude = fade(1.3, footprint)
        if amplitude > 0.0:
            patch += 0.7 * amplitude * value_noise(x / 1.3, y / 1.3, seed + 22)
        amplitude = fade(0.3, footprint)
        if amplitude > 0.0:
            patch += 0.5 * amplitude * value_noise(x / 0.3, y / 0.3, seed + 23)
        opacity = 1.0 - wear * (0.35 + 0.65 * soft_step(0.5 + 0.9 * patch))
    if looks.missing[i] > 0.0:
        # value noise at 20 m, its quantiles about those of a normal of deviation 0.36
        stretch = value_noise(x / 20.0, y / 20.0, seed + 24)
        threshold = 1.0 - 2.0 * looks.missing[i] if looks.missing[i] > 0.4 else 0.62 - 1.2 * looks.missing[i]
        opacity *= 1.0 - soft_step((stretch - threshold) / 0.08 + 0.5)
    return opacity
