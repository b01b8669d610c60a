"""Asphalt, verge and paint on the canvas, before any light falls on them.

The canvas (some rows, width) float32 holds the light on image rows (up from the bottom) from `first` on. It
is small enough to stay in the first-level cache while the layers are painted one after the other. A single
row would be too small: reading what was just written in differently sized chunks stalls on the store buffer,
which costs more than the arithmetic.
"""

import math
from typing import NamedTuple

import numpy as np

from camera_synth.camera import WIDTH_PX
from camera_synth.degrade import fade, interpolate, soft_step, value_noise
from camera_synth.ground_kernels import (
    LEFT_EDGE,
    RIGHT_EDGE,
    paint_band,
    paint_dashes,
    row_line,
    whole_vectors,
)
from camera_synth.pattern_kernels import ROOM, Octave, add_octave
from sumo_net.compile import inlined, kernel
from sumo_net.road import DASHED, MAX_BORDERS

_LEAST_LANE_PX = 11.5  # in a narrower lane, wheel tracks are thinner than a pixel
_FAR = 1.0e6  # columns; stands for an edge outside the image


class View(NamedTuple):
    """Position and direction of a camera in the world."""

    x: float
    y: float
    sin: float
    cos: float


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
def view_of(x, y, heading, p):  # type: ignore[no-untyped-def]
    """The View of a camera on a vehicle with this pose."""
    sin, cos = math.sin(heading), math.cos(heading)
    return View(
        x + cos * p.forward - sin * p.left,
        y + sin * p.forward + cos * p.left,
        sin * p.cos_yaw + cos * p.sin_yaw,
        cos * p.cos_yaw - sin * p.sin_yaw,
    )


@kernel
def strip_of(y, footprint, view, p):  # type: ignore[no-untyped-def]
    """The Strip of image row y."""
    ahead, depth = row_line(np.float64(y), p)
    step = -depth / p.focal
    aside = -p.center_x * step
    return Strip(
        ahead,
        footprint,
        aside,
        step,
        view.x + view.cos * ahead - view.sin * aside,
        view.y + view.sin * ahead + view.cos * aside,
        -view.sin * step,
        view.cos * step,
    )


@kernel
def texture_ground(grid, rows, ground, look, view, p):  # type: ignore[no-untyped-def]
    """The texture of the lowest `rows` rows on `grid` (rows, ROOM)."""
    grid[:rows] = 0.0
    if look.texture <= 0.0:
        return
    for k in range(3):
        wavelength = 0.4 * 4.0**k
        f = 1.0 / wavelength
        octave = Octave(f, 0.0, 0.0, f, wavelength, 2**k, look.world_seed + 11 + k, 1.0)
        add_octave(grid, rows, ground, octave, view, p)


@inlined
def paint_ground(canvas, grid, first, end, beside, crossings, look):  # type: ignore[no-untyped-def]
    """Asphalt between its edges and verge beside it on rows `first` to `end` - 1, with `texture_ground`.

    beside: float32 scratch (WIDTH_PX,).
    """
    kind, column = crossings.kind, crossings.column
    node = np.empty(ROOM, np.float32)
    for y in range(first, end):
        right = kind[RIGHT_EDGE, y] != 0 and kind[RIGHT_EDGE, y + 1] != 0
        left = kind[LEFT_EDGE, y] != 0 and kind[LEFT_EDGE, y + 1] != 0
        l0, l1, r0, r1 = _FAR, _FAR, -_FAR, -_FAR
        if right or left:  # where only one edge is in view, asphalt fills the other side
            l0, l1 = (column[LEFT_EDGE, y], column[LEFT_EDGE, y + 1]) if left else (-_FAR, -_FAR)
            r0, r1 = (column[RIGHT_EDGE, y], column[RIGHT_EDGE, y + 1]) if right else (_FAR, _FAR)
        _tone(canvas[y - first], node, grid[y], look.asphalt_grey, look.texture)
        half_l, half_r = 0.5 * (1.0 + abs(l1 - l0)), 0.5 * (1.0 + abs(r1 - r0))
        left_end, right_first = 0.5 * (l0 + l1) + half_l, 0.5 * (r0 + r1) - half_r
        if left_end <= 0.0 and right_first >= WIDTH_PX - 1.0:
            continue
        _tone(beside, node, grid[y], look.verge_grey, 2.0 * look.texture)
        # coverage of the pixels that an edge crosses, as a ramp over those columns
        rise_l, rise_r = np.float32(0.5 / half_l), np.float32(0.5 / half_r)
        at_l, at_r = np.float32(1.0 - left_end * 0.5 / half_l), np.float32(1.0 + right_first * 0.5 / half_r)
        _, end_l = whole_vectors(0, math.ceil(left_end))
        first_r, _ = whole_vectors(math.ceil(right_first), WIDTH_PX)
        for x0, x1 in ((0, end_l), (max(first_r, end_l), WIDTH_PX)):
            _blend_verge(canvas[y - first, x0:x1], beside[x0:x1], np.float32(x0), rise_l, at_l, rise_r, at_r)


@inlined
def _tone(row, node, texture, grey, strength):  # type: ignore[no-untyped-def]
    """Fill the row with a grey plus `strength` times the texture at its nodes."""
    level, part = np.float32(grey), np.float32(strength)
    for m in range(ROOM):
        node[m] = level + part * texture[m]
    interpolate(node, row)


@inlined
def _blend_verge(asphalt, verge, start, rise_l, at_l, rise_r, at_r):  # type: ignore[no-untyped-def]
    zero, one = np.float32(0.0), np.float32(1.0)
    for x in range(asphalt.shape[0]):
        f = np.float32(np.int32(x)) + start
        cover = min(max(min(f * rise_l + at_l, at_r - f * rise_r), zero), one)
        asphalt[x] = verge[x] + (asphalt[x] - verge[x]) * cover


@inlined
def paint_tracks(canvas, first, end, crossings, look):  # type: ignore[no-untyped-def]
    """Two darker wheel tracks in each lane between markings, on rows `first` to `end` - 1."""
    kind, column = crossings.kind, crossings.column
    for y in range(first, end):
        row = canvas[y - first]
        for k in range(MAX_BORDERS - 1):
            if kind[k, y] == 0 or kind[k + 1, y] == 0 or kind[k, y + 1] == 0 or kind[k + 1, y + 1] == 0:
                continue
            a = 0.5 * (column[k, y] + column[k, y + 1])
            b = 0.5 * (column[k + 1, y] + column[k + 1, y + 1])
            if abs(b - a) >= _LEAST_LANE_PX and max(a, b) > 0.0 and min(a, b) < WIDTH_PX:
                _paint_lane(row, 0.5 * (a + b), abs(b - a), look.wheel_tracks)


@inlined
def _paint_lane(row, centre, width, grey):  # type: ignore[no-untyped-def]
    """The tracks of a lane: at 0.2 of its width to either side of its centre, each ± 0.13 of it wide."""
    reach = 0.33 * width
    first, end = whole_vectors(math.ceil(centre - reach), math.floor(centre + reach) + 1)
    part = row[first:end]
    scale, start = np.float32(1.0 / (0.13 * width)), np.float32((first - centre) / (0.13 * width))
    depth, zero, one, off = np.float32(grey), np.float32(0.0), np.float32(1.0), np.float32(0.2 / 0.13)
    for x in range(part.shape[0]):
        t = abs(start + np.float32(np.int32(x)) * scale) - off
        t = max(one - t * t, zero)
        part[x] -= depth * t * t


@inlined
def paint_markings(canvas, lowest, end, crossings, look, view, p):  # type: ignore[no-untyped-def]
    """The markings on rows `lowest` to `end` - 1, by the share of each pixel they cover, less the wear."""
    kind, column, scale, station = crossings.kind, crossings.column, crossings.scale, crossings.station
    stroke, period = look.dash_stroke_m, look.dash_stroke_m + look.dash_gap_m
    per_period = 1.0 / period
    worn = look.wear > 0.0 or look.missing > 0.0
    grey = look.paint_grey
    for y in range(lowest, end):
        row = canvas[y - lowest]
        strip = strip_of(y, crossings.ahead[y + 1] - crossings.ahead[y], view, p)
        first, last = MAX_BORDERS, -1
        for k in range(MAX_BORDERS):
            if kind[k, y] != 0:
                first, last = min(first, k), k
        for k in range(first, last + 1):
            if kind[k, y] == 0 or kind[k, y + 1] == 0:
                continue
            width = look.edge_width_m if k in (first, last) else look.marking_width_m
            h0, h1 = 0.5 * width * scale[k, y], 0.5 * width * scale[k, y + 1]
            c0, c1 = column[k, y], column[k, y + 1]
            if max(c0 + h0, c1 + h1) < -1.0 or min(c0 - h0, c1 - h1) > row.shape[0]:
                continue
            s0, s1 = station[k, y], station[k, y + 1]
            l0, l1, r0, r1 = c0 - h0, c1 - h1, c0 + h0, c1 + h1
            dashed = kind[k, y] == DASHED
            phase = s0 - math.floor(s0 * per_period) * period
            if dashed and phase > stroke and phase + (s1 - s0) < period:
                continue
            opacity = 1.0
            if worn:
                x = 0.5 * (c0 + c1)
                opacity = paint_left(look, strip.x + x * strip.dx, strip.y + x * strip.dy, strip.footprint)
            if dashed:
                paint_dashes(row, l0, l1, r0, r1, phase, s1 - s0, stroke, period, grey, opacity)
            else:
                paint_band(row, l0, l1, r0, r1, grey, opacity)


@inlined
def paint_left(look, x, y, footprint):  # type: ignore[no-untyped-def]
    """Opacity of the paint at a place in the world."""
    seed, wear = look.world_seed, look.wear
    opacity = 1.0
    if wear > 0.0:
        patch = 0.6 * _patches(9.0, x, y, seed + 21)
        amplitude = fade(1.3, footprint)
        if amplitude > 0.0:
            patch += 0.7 * amplitude * _patches(1.3, x, y, seed + 22)
        amplitude = fade(0.3, footprint)
        if amplitude > 0.0:
            patch += 0.5 * amplitude * _patches(0.3, x, y, seed + 23)
        opacity = 1.0 - wear * (0.35 + 0.65 * soft_step(0.5 + 0.9 * patch))
    if look.missing > 0.0:
        # value noise at 20 m; its quantiles are about those of a normal with standard deviation 0.36
        stretch = _patches(20.0, x, y, seed + 24)
        threshold = 1.0 - 2.0 * look.missing if look.missing > 0.4 else 0.62 - 1.2 * look.missing
        opacity *= 1.0 - soft_step((stretch - threshold) * (1.0 / 0.08) + 0.5)
    return opacity


@kernel
def _patches(wavelength, x, y, seed):  # type: ignore[no-untyped-def]
    per_metre = 1.0 / wavelength
    return value_noise(x * per_metre, y * per_metre, seed)
