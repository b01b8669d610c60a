"""Patterns in the world and slow changes in time: smooth noise from counter-based hashes, without state.

Patterns vary slowly across a row, so they are evaluated at nodes NODE_PX columns apart and interpolated.
Octaves shorter than the ground that a row spans are faded out; with a focal length of 925 px this leaves no
wavelength below 24 columns.
"""

import math
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import intrinsic

from camera_synth.camera import WIDTH_PX
from sumo_net.compile import kernel
from sumo_net.randomness import bits

NODE_PX = 8

_P1, _P2, _P3 = np.uint32(0x9E3779B1), np.uint32(0x85EBCA77), np.uint32(0xC2B2AE3D)
_M1, _M2 = np.uint32(0x21F0AAAD), np.uint32(0x735A2D97)


def _times(typing, a, b):  # type: ignore[no-untyped-def]
    """a · b mod 2³² of two uint32, in 32 bits (numba's own product has 64, which halves the vectors)."""

    def code(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.mul(*arguments)

    return types.uint32(types.uint32, types.uint32), code


times: Any = intrinsic(_times)


@kernel
def contrast_left(distance, look):  # type: ignore[no-untyped-def]
    """Share of the contrast that is left at a distance in m: Koschmieder's law, a half at visibility_m."""
    return math.exp(-math.log(2.0) * distance / look.visibility_m)


@kernel
def _lattice(hu, hv):  # type: ignore[no-untyped-def]
    """float32 in [0, 2³²] of a lattice point, given its two scrambled coordinates."""
    h = np.uint32(hu ^ hv)
    return np.float32(times(np.uint32(h ^ (h >> np.uint32(15))), _M1))


@kernel
def _between(hu, hv, a, b):  # type: ignore[no-untyped-def]
    """Smooth noise in [-1, 1] in a lattice cell, at fractions a and b of its sides from point (hu, hv)."""
    two, three = np.float32(2.0), np.float32(3.0)
    hu1, hv1 = np.uint32(hu + _P1), np.uint32(hv + _P2)
    a = a * a * (three - two * a)
    b = b * b * (three - two * b)
    near, far = _lattice(hu, hv), _lattice(hu, hv1)
    low = near + (_lattice(hu1, hv) - near) * a
    high = far + (_lattice(hu1, hv1) - far) * a
    return (low + (high - low) * b) * np.float32(2.0**-31) - np.float32(1.0)


@kernel
def noise_line(out, u, v, du, dv, seed):  # type: ignore[no-untyped-def]
    """out[i] = N(u + i du, v + i dv) for smooth noise N in [-1, 1] on the unit lattice.

    out (m,) float32; u, v float64 lattice coordinates of its first point; seed integer. A 32-bit loop counter
    halves the time; a remainder of fewer than eight points costs as much as eight.
    """
    cell_u, cell_v = np.floor(u), np.floor(v)
    u0, v0 = np.float32(u - cell_u), np.float32(v - cell_v)
    su, sv = np.float32(du), np.float32(dv)
    bu, bv = np.uint32(np.int64(cell_u)), np.uint32(np.int64(cell_v))
    salt = np.uint32(np.uint32(seed) * _P3)
    for i in range(out.shape[0]):
        at = np.float32(np.int32(i))
        x = u0 + at * su
        y = v0 + at * sv
        fx, fy = np.floor(x), np.floor(y)
        hu = np.uint32(np.uint32(bu + np.uint32(np.int32(fx))) * _P1)
        hv = np.uint32(np.uint32(np.uint32(bv + np.uint32(np.int32(fy))) * _P2) + salt)
        out[i] = _between(hu, hv, x - fx, y - fy)


@kernel
def value_noise(u, v, seed):  # type: ignore[no-untyped-def]
    """The same noise at one point."""
    cell_u, cell_v = math.floor(u), math.floor(v)
    hu = np.uint32(np.uint32(np.int64(cell_u)) * _P1)
    hv = np.uint32(np.uint32(np.uint32(np.int64(cell_v)) * _P2) + np.uint32(np.uint32(seed) * _P3))
    return np.float64(_between(hu, hv, np.float32(u - cell_u), np.float32(v - cell_v)))


@kernel
def lattice_unit(cell, seed):  # type: ignore[no-untyped-def]
    """A uniform draw in [0, 1) for an integer cell."""
    h = np.uint32(np.uint32(np.uint32(cell) * _P1) ^ np.uint32(np.uint32(seed) * _P3))
    h = times(np.uint32(h ^ (h >> np.uint32(15))), _M1)
    return np.float64(np.uint32(h ^ (h >> np.uint32(13))) >> np.uint32(8)) * 2.0**-24


@kernel
def fade(wavelength, footprint):  # type: ignore[no-untyped-def]
    """1 where a footprint (m) samples a wavelength (m) at least four times, 0 where twice or less."""
    return min(max(2.0 - 4.0 * footprint / wavelength, 0.0), 1.0)


@kernel
def soft_step(t):  # type: ignore[no-untyped-def]
    """0 below 0, 1 above 1, smooth between."""
    t = min(max(t, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@kernel
def interpolate(nodes, out):  # type: ignore[no-untyped-def]
    """Interpolate nodes (at least WIDTH_PX / NODE_PX + 1,) linearly to columns, out (WIDTH_PX,); float32."""
    step = np.float32(1.0 / NODE_PX)
    for i in range(WIDTH_PX // NODE_PX):
        at = nodes[i]
        change = (nodes[i + 1] - at) * step
        for k in range(NODE_PX):
            out[NODE_PX * i + k] = at + np.float32(np.int32(k)) * change


@kernel
def smooth_walk(key, time):  # type: ignore[no-untyped-def]
    """A smooth random function of time in [-1, 1]; values two units of time apart are independent."""
    cell = np.int64(np.floor(time))
    t = soft_step(time - cell)
    low = np.float64(bits(key, cell) >> np.uint64(11)) * 2.0**-52 - 1.0
    high = np.float64(bits(key, cell + 1) >> np.uint64(11)) * 2.0**-52 - 1.0
    return low + (high - low) * t
