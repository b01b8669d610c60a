"""The light on the ground: trees' and overpasses' shadows, headlights, haze."""

import math

import numpy as np

from camera_synth.degrade import NODE_PX, add_value_noise, fade, interpolate, lattice_unit
from camera_synth.ground_kernels import PATH
from camera_synth.surface_kernels import strip_of
from sumo_net.compile import kernel


@kernel
def light_ground(canvas, field, node, rows, crossings, look, view, p):  # type: ignore[no-untyped-def]
    """Light the lowest `rows` rows of the canvas, and fade them to haze with the distance."""
    even = look.shadow <= 0.0 and look.overpass <= 0.0 and look.headlight <= 0.0
    if not even:
        for y in range(rows):
            strip = strip_of(y, crossings.ahead[y + 1] - crossings.ahead[y], view, p)
            node[:] = 1.0
            if look.shadow > 0.0:
                _tree_shadow(node, look, strip)
            if look.overpass > 0.0 and crossings.kind[y, PATH] != 0 and crossings.kind[y + 1, PATH] != 0:
                _overpass_shadow(node, y, crossings, look, strip)
            if look.headlight > 0.0:
                _headlights(node, look, strip)
            interpolate(node, field[y])
    daylight = 1.0 if look.headlight > 0.0 else look.ambient  # headlights have it counted in
    for y in range(rows):
        keep = look.visibility_m / (look.visibility_m + 0.5 * (crossings.ahead[y] + crossings.ahead[y + 1]))
        haze = np.float32(look.haze_grey * look.ambient * (1.0 - keep))
        if even:
            _dim(canvas[y], np.float32(keep * daylight), haze)
        else:
            _shade(canvas[y], field[y], np.float32(keep * daylight), haze)


@kernel
def _dim(row, scale, haze):  # type: ignore[no-untyped-def]
    for x in range(row.shape[0]):
        row[x] = row[x] * scale + haze


@kernel
def _shade(row, share, scale, haze):  # type: ignore[no-untyped-def]
    for x in range(row.shape[0]):
        row[x] = row[x] * (share[x] * scale) + haze


@kernel
def _headlights(node, look, strip):  # type: ignore[no-untyped-def]
    """Turn the share of daylight in `node` into light, with the headlights'."""
    fall = 1.0 + strip.ahead / look.headlight_reach_m
    beam, width = look.headlight / (fall * fall), 2.0 + 0.18 * strip.ahead
    for m in range(node.shape[0]):
        t = (strip.aside + strip.step * NODE_PX * m) / width
        node[m] = np.float32(look.ambient * node[m] + beam / (1.0 + t * t))


@kernel
def _overpass_shadow(node, y, crossings, look, strip):  # type: ignore[no-untyped-def]
    """Take the overpass's share of the light where the row lies in its shadow, a band across the road."""
    s0, s1 = crossings.station[y, PATH], crossings.station[y + 1, PATH]
    middle, half = 0.5 * (s0 + s1), 0.5 * max(strip.footprint, 0.6)
    near, far = overpass_at(middle, look.overpass_spacing_m, look.world_seed)
    slope = 0.5 * (crossings.slope[y, PATH] + crossings.slope[y + 1, PATH])
    sideways = slope / math.sqrt(1.0 + slope * slope)  # station gained per metre to the left
    centre = 0.5 * (crossings.aside[y, PATH] + crossings.aside[y + 1, PATH])
    first = middle + (strip.aside - centre) * sideways
    step = strip.step * NODE_PX * sideways
    end = first + step * (node.shape[0] - 1)
    if max(first, end) + half <= near or min(first, end) - half >= far:
        return
    for m in range(node.shape[0]):
        s = first + step * m
        inside = max(min(s + half, far) - max(s - half, near), 0.0) / (2.0 * half)
        node[m] *= np.float32(1.0 - look.overpass * inside)


@kernel
def _tree_shadow(node, look, strip):  # type: ignore[no-untyped-def]
    """Set `node` to the share of light that trees leave.

    Two octaves stretched along the sun's direction, and a slow one that says where trees stand at all.
    """
    sin_s, cos_s = math.sin(look.sun_azimuth_rad + 1.1), math.cos(look.sun_azimuth_rad + 1.1)
    u, v = cos_s * strip.x + sin_s * strip.y, -sin_s * strip.x + cos_s * strip.y
    du, dv = NODE_PX * (cos_s * strip.dx + sin_s * strip.dy), NODE_PX * (-sin_s * strip.dx + cos_s * strip.dy)
    seed = look.world_seed
    node[:] = 0.0
    add_value_noise(
        node,
        strip.x / 60.0,
        strip.y / 60.0,
        NODE_PX * strip.dx / 60.0,
        NODE_PX * strip.dy / 60.0,
        seed + 31,
        0.8,
    )
    amplitude = fade(5.0, strip.footprint)
    if amplitude > 0.0:
        add_value_noise(node, u / 11.0, v / 5.0, du / 11.0, dv / 5.0, seed + 32, 0.8 * amplitude)
    amplitude = fade(1.2, strip.footprint)
    if amplitude > 0.0:
        add_value_noise(node, u / 2.2, v / 1.2, du / 2.2, dv / 1.2, seed + 33, 0.45 * amplitude)
    threshold = np.float32(0.85 - 1.7 * look.shadow_cover)
    strength = np.float32(look.shadow)
    sharp = np.float32(4.0)
    zero, one, two, three = np.float32(0.0), np.float32(1.0), np.float32(2.0), np.float32(3.0)
    half = np.float32(0.5)
    for m in range(node.shape[0]):
        t = min(max((node[m] - threshold) * sharp + half, zero), one)
        node[m] = one - strength * (t * t * (three - two * t))


@kernel
def overpass_at(station, spacing, seed):  # type: ignore[no-untyped-def]
    """(near, far) stations of the overpass in this stretch of an edge."""
    cell = math.floor(station / spacing)
    draw = lattice_unit(np.int64(cell), seed + 41)
    near = (cell + 0.15 + 0.6 * draw) * spacing
    return near, near + 8.0 + 10.0 * draw
