"""The light on the ground: trees' and overpasses' shadows, headlights, haze."""

import math

import numpy as np

from camera_synth.camera import WIDTH_PX
from camera_synth.degrade import NODE_PX, contrast_left, interpolate, lattice_unit
from camera_synth.ground_kernels import PATH
from camera_synth.pattern_kernels import NODES, ROOM, Octave, add_octave
from camera_synth.surface_kernels import strip_of
from sumo_net.compile import inlined, kernel


@kernel
def cast_light(grid, rows, ground, crossings, look, view, p):  # type: ignore[no-untyped-def]
    """Light on the lowest `rows` rows into `grid` (rows, ROOM); returns False for uniform daylight."""
    if look.shadow <= 0.0 and look.overpass <= 0.0 and look.headlight <= 0.0:
        return False
    if look.shadow > 0.0:
        _tree_shadow(grid, rows, ground, look, view, p)
    else:
        grid[:rows] = 1.0
    if look.overpass <= 0.0 and look.headlight <= 0.0:
        return True
    for y in range(rows):
        strip = strip_of(y, crossings.ahead[y + 1] - crossings.ahead[y], view, p)
        if look.overpass > 0.0 and crossings.kind[PATH, y] != 0 and crossings.kind[PATH, y + 1] != 0:
            _overpass_shadow(grid[y], y, crossings, look, strip)
        if look.headlight > 0.0:
            _headlights(grid[y], look, strip)
    return True


@inlined
def light_ground(canvas, grid, uneven, first, end, light, crossings, look):  # type: ignore[no-untyped-def]
    """Light rows `first` to `end` - 1 of the canvas by `cast_light`, and fade them to haze with distance.

    light: float32 scratch (WIDTH_PX,).
    """
    daylight = 1.0 if look.headlight > 0.0 else look.ambient  # `_headlights` includes it in the grid
    for y in range(first, end):
        keep = contrast_left(0.5 * (crossings.ahead[y] + crossings.ahead[y + 1]), look)
        haze = np.float32(look.haze_grey * look.ambient * (1.0 - keep))
        scale, row = np.float32(keep * daylight), canvas[y - first]
        if uneven:
            interpolate(grid[y], light)
            for x in range(WIDTH_PX):
                row[x] = row[x] * light[x] * scale + haze
        else:
            for x in range(WIDTH_PX):
                row[x] = row[x] * scale + haze


@kernel
def _headlights(node, look, strip):  # type: ignore[no-untyped-def]
    """Turn the share of daylight in `node` into light, that of the headlights added."""
    fall = 1.0 + strip.ahead / look.headlight_reach_m
    beam, width = look.headlight / (fall * fall), 2.0 + 0.18 * strip.ahead
    for m in range(NODES):
        t = (strip.aside + strip.step * NODE_PX * m) / width
        node[m] = np.float32(look.ambient * node[m] + beam / (1.0 + t * t))


@kernel
def _overpass_shadow(node, y, crossings, look, strip):  # type: ignore[no-untyped-def]
    """Reduce the light where the row lies in the overpass's shadow, a band across the road."""
    s0, s1 = crossings.station[PATH, y], crossings.station[PATH, y + 1]
    middle, half = 0.5 * (s0 + s1), 0.5 * max(strip.footprint, 0.6)
    near, far = overpass_at(middle, look.overpass_spacing_m, look.world_seed)
    slope = 0.5 * (crossings.slope[PATH, y] + crossings.slope[PATH, y + 1])
    sideways = slope / math.sqrt(1.0 + slope * slope)  # station gained per metre to the left
    centre = 0.5 * (crossings.aside[PATH, y] + crossings.aside[PATH, y + 1])
    first = middle + (strip.aside - centre) * sideways
    step = strip.step * NODE_PX * sideways
    end = first + step * (NODES - 1)
    if max(first, end) + half <= near or min(first, end) - half >= far:
        return
    for m in range(NODES):
        s = first + step * m
        inside = max(min(s + half, far) - max(s - half, near), 0.0) / (2.0 * half)
        node[m] *= np.float32(1.0 - look.overpass * inside)


@kernel
def _tree_shadow(grid, rows, ground, look, view, p):  # type: ignore[no-untyped-def]
    """Set `grid` to the share of light that trees leave.

    Two octaves stretched along the sun's direction, and one of long wavelength for where there are trees.
    """
    s, c = math.sin(look.sun_azimuth_rad + 1.1), math.cos(look.sun_azimuth_rad + 1.1)
    seed = look.world_seed
    grid[:rows] = 0.0
    # the long one fades out only in rows that show no ground
    add_octave(grid, rows, ground, Octave(1.0 / 60.0, 0.0, 0.0, 1.0 / 60.0, 60.0, 4, seed + 31, 0.8), view, p)
    for k in range(2):
        u, v, stride, amplitude = (11.0, 5.0, 2, 0.8) if k == 0 else (2.2, 1.2, 1, 0.45)
        octave = Octave(c / u, s / u, -s / v, c / v, v, stride, seed + 32 + k, amplitude)
        add_octave(grid, rows, ground, octave, view, p)
    threshold = np.float32(0.85 - 1.7 * look.shadow_cover)
    strength = np.float32(look.shadow)
    sharp = np.float32(4.0)
    zero, one, two, three = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(3.0)
    half = np.float32(0.5)
    for y in range(rows):
        node = grid[y]
        for m in range(ROOM):
            t = min(max((node[m] - threshold) * sharp + half, zero), one)
            node[m] = one - strength * (t * t * (three - two * t))


@kernel
def overpass_at(station, spacing, seed):  # type: ignore[no-untyped-def]
    """(near, far) stations of the overpass in the stretch of length `spacing` around a station."""
    cell = math.floor(station / spacing)
    draw = lattice_unit(np.int64(cell), seed + 41)
    near = (cell + 0.15 + 0.6 * draw) * spacing
    return near, near + 8.0 + 10.0 * draw
