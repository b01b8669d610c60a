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
def paint_ground(row, cover, texture, node, y, crossings, look, strip):  # type: ignore[no-untyped-def]
    """Asphalt between its edges and verge beside it, with the texture of both."""
    kind, column = crossings.kind, crossings.column
    right = kind[y, RIGHT_EDGE] != 0 and kind[y + 1, RIGHT_EDGE] != 0
    left = kind[y, LEFT_EDGE] != 0 and kind[y + 1, LEFT_EDGE] != 0
    if right or left:  # where one edge has turned away before the other, asphalt fills its side
        l0 = column[y, LEFT_EDGE] if left else -_FAR
        l1 = column[y + 1, LEFT_EDGE] if left else -_FAR
        r0 = column[y, RIGHT_EDGE] if right else _FAR
        r1 = column[y + 1, RIGHT_EDGE] if right else _FAR
        cover_between(cover, l0, l1, r0, r1)
    else:
        cover[:] = 0.0
    seed = look.world_seed
    strength = look.texture
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
    verge = np.float32(look.verge_grey)
    rise = np.float32(look.asphalt_grey) - verge
    if active:
        interpolate(node, texture)
        rough = np.float32(strength * 2.0)
        less = np.float32(strength) - rough
        for x in range(row.shape[0]):
            row[x] = verge + rise * cover[x] + texture[x] * (rough + less * cover[x])
    else:
        for x in range(row.shape[0]):
            row[x] = verge + rise * cover[x]
    if look.wheel_tracks > 0.0:
        for k in range(MAX_BORDERS - 1):
            if kind[y, k] != 0 and kind[y, k + 1] != 0 and kind[y + 1, k] != 0 and kind[y + 1, k + 1] != 0:
                a = 0.5 * (column[y, k] + column[y + 1, k])
                span = 0.5 * (column[y, k + 1] + column[y + 1, k + 1]) - a
                _paint_track(row, a + 0.3 * span, 0.13 * abs(span), look.wheel_tracks)
                _paint_track(row, a + 0.7 * span, 0.13 * abs(span), look.wheel_tracks)


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
def paint_markings(row, y, crossings, look, strip):  # type: ignore[no-untyped-def]
    kind, column, scale, station = crossings.kind, crossings.column, crossings.scale, crossings.station
    stroke = look.dash_stroke_m
    period = stroke + look.dash_gap_m
    first, last = MAX_BORDERS, -1
    for k in range(MAX_BORDERS):
        if kind[y, k] != 0:
            first, last = min(first, k), k
    for k in range(first, last + 1):
        if kind[y, k] == 0 or kind[y + 1, k] == 0:
            continue
        line = look.edge_width_m if k in (first, last) else look.marking_width_m
        h0, h1 = 0.5 * line * scale[y, k], 0.5 * line * scale[y + 1, k]
        c0, c1 = column[y, k], column[y + 1, k]
        if max(c0 + h0, c1 + h1) < -1.0 or min(c0 - h0, c1 - h1) > row.shape[0]:
            continue
        opacity = 1.0
        if look.wear > 0.0 or look.missing > 0.0:
            x = 0.5 * (c0 + c1)
            opacity = _paint_left(look, strip.x + x * strip.dx, strip.y + x * strip.dy, strip.footprint)
        grey = look.paint_grey
        if kind[y, k] == DASHED:
            paint_dashes(
                row,
                c0 - h0,
                c1 - h1,
                c0 + h0,
                c1 + h1,
                station[y, k],
                station[y + 1, k],
                stroke,
                period,
                grey,
                opacity,
            )
        else:
            paint_band(row, c0 - h0, c1 - h1, c0 + h0, c1 + h1, grey, opacity)


@kernel
def _paint_left(look, x, y, footprint):  # type: ignore[no-untyped-def]
    """Opacity of the paint at a place in the world."""
    seed, wear = look.world_seed, look.wear
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
    if look.missing > 0.0:
        # value noise at 20 m, its quantiles about those of a normal of deviation 0.36
        stretch = value_noise(x / 20.0, y / 20.0, seed + 24)
        threshold = 1.0 - 2.0 * look.missing if look.missing > 0.4 else 0.62 - 1.2 * look.missing
        opacity *= 1.0 - soft_step((stretch - threshold) / 0.08 + 0.5)
    return opacity
