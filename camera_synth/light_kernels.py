"""The light on one image row of ground: trees' and overpasses' shadows, headlights, haze."""

import math

import numpy as np

from camera_synth.degrade import NODE_PX, add_value_noise, fade, interpolate, lattice_unit
from camera_synth.ground_kernels import PATH
from sumo_net.compile import kernel


@kernel
def light(row, shade, node, y, crossings, look, strip):  # type: ignore[no-untyped-def]
    """Daylight less the shadows that lie on the row, headlights, then haze."""
    keep = look.visibility_m / (look.visibility_m + strip.ahead)
    haze = np.float32(look.haze_grey * look.ambient * (1.0 - keep))
    ambient = look.ambient
    even = True
    if look.shadow > 0.0:
        even = not _tree_shadow(node, look, strip)
    if look.overpass > 0.0 and crossings.kind[y, PATH] != 0 and crossings.kind[y + 1, PATH] != 0:
        s0, s1 = crossings.station[y, PATH], crossings.station[y + 1, PATH]
        near, far = overpass_at(0.5 * (s0 + s1), look.overpass_spacing_m, look.world_seed)
        slope = 0.5 * (crossings.slope[y, PATH] + crossings.slope[y + 1, PATH])
        sideways = slope / math.sqrt(1.0 + slope * slope)
        centre = 0.5 * (crossings.aside[y, PATH] + crossings.aside[y + 1, PATH])
        half = 0.5 * max(strip.footprint, 0.6)
        spread = (strip.aside + abs(strip.step) * 400.0) * abs(sideways)
        middle = 0.5 * (s0 + s1)
        if middle + spread + half > near and middle - spread - half < far:
            if even:
                node[:] = 1.0
                even = False
            for m in range(node.shape[0]):
                s = middle + (strip.aside + strip.step * NODE_PX * m - centre) * sideways
                inside = min(max(min(s + half, far) - max(s - half, near), 0.0), 2.0 * half) / (2.0 * half)
                node[m] *= np.float32(1.0 - look.overpass * inside)
    if look.headlight > 0.0:
        if even:
            node[:] = 1.0
            even = False
        fall = 1.0 + strip.ahead / look.headlight_reach_m
        beam, width = look.headlight / (fall * fall), 2.0 + 0.18 * strip.ahead
        for m in range(node.shape[0]):
            t = (strip.aside + strip.step * NODE_PX * m) / width
            node[m] = np.float32(ambient * node[m] + beam / (1.0 + t * t))
        ambient = 1.0
    if even:
        scale = np.float32(keep * ambient)
        for x in range(row.shape[0]):
            row[x] = row[x] * scale + haze
    else:
        scale = np.float32(keep * ambient)
        interpolate(node, shade)
        for x in range(row.shape[0]):
            row[x] = row[x] * (shade[x] * scale) + haze


@kernel
def _tree_shadow(node, look, strip):  # type: ignore[no-untyped-def]
    """Set node to the share of light that trees leave; False where there is nothing to set.

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
    return True


@kernel
def overpass_at(station, spacing, seed):  # type: ignore[no-untyped-def]
    """(near, far) stations of the overpass in this stretch of an edge."""
    cell = math.floor(station / spacing)
    draw = lattice_unit(np.int64(cell), seed + 41)
    near = (cell + 0.15 + 0.6 * draw) * spacing
    return near, near + 8.0 + 10.0 * draw
