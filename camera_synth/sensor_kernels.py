"""From the light on a row to 8-bit grey: exposure, vignetting, veil of glare, noise."""

import math
from typing import NamedTuple

import numpy as np

from camera_synth.degrade import NODE_PX, interpolate, smooth_walk, times
from sumo_net.compile import kernel
from sumo_net.randomness import bits

_VEIL_GREY = 235.0
_M1, _M2 = np.uint32(0x21F0AAAD), np.uint32(0x735A2D97)
_LOW = np.uint32(0x00FF00FF)
_WORD = np.uint64(0xFFFFFFFF)
_BYTE_SUM_MEAN, _BYTE_SUM_DEVIATION = 510.0, 147.79885  # of four independent bytes: sqrt(4 (2¹⁶ − 1) / 12)


class Exposure(NamedTuple):
    """How one vehicle's camera takes this frame."""

    gain: float
    offset: float  # grey levels
    vignetting: float  # share of the light lost in the corners
    glare: float  # share of the contrast lost where the sun stands
    sun_x: float  # px
    sun_y: float
    noise: float  # standard deviation, grey levels


@kernel
def exposure_of(look, sin_c, cos_c, horizon, p, key, counter):  # type: ignore[no-untyped-def]
    """The Exposure of frame `counter` of a camera that looks along (cos_c, sin_c) in the world."""
    time = counter / look.drift_frames
    gain = 1.0 + look.drift * smooth_walk(key ^ np.uint64(0x5EED), time)
    offset = look.drift_grey * smooth_walk(key ^ np.uint64(0xB1AC), time)
    sin_s, cos_s = math.sin(look.sun_azimuth_rad), math.cos(look.sun_azimuth_rad)
    across, along = sin_s * cos_c - cos_s * sin_c, cos_s * cos_c + sin_s * sin_c
    glare = look.glare * max(0.0, along) ** 2
    sun_x = p.center_x - p.focal * across / max(along, 0.2)
    sun_y = horizon + 0.15 * p.focal_y  # a low sun: 8.5 degrees
    return Exposure(gain, offset, look.vignetting, glare, sun_x, sun_y, look.noise_grey)


@kernel
def read_out(frame, canvas, field, node, exposure, key, counter):  # type: ignore[no-untyped-def]
    """frame (height, width) uint8: number `counter`, from the light on its lowest rows, canvas (rows, width).

    Frames are counted in the noise's key by 2¹² rows each.
    """
    height, width = frame.shape
    rows = canvas.shape[0]
    corner = np.zeros(width, np.float32)  # squared distance from the centre, 1 in the corners
    columns = np.zeros(width, np.uint32)
    for x in range(width):
        columns[x] = x
        corner[x] = (2.0 * x - width) ** 2 / (width**2 + height**2)
    glaring = exposure.glare > 0.0
    if glaring:
        for y in range(rows):
            rise = (y - exposure.sun_y) ** 2
            for m in range(node.shape[0]):
                away = (NODE_PX * m - exposure.sun_x) ** 2 + rise
                node[m] = np.float32(exposure.glare * (0.45 + 0.55 / (1.0 + away / 140.0**2)))
            interpolate(node, field[y])
    else:
        field[0] = 0.0
    for y in range(rows):
        dark = exposure.vignetting * (2.0 * y - height) ** 2 / (width**2 + height**2)
        expose(
            frame[height - 1 - y],
            canvas[y],
            field[y if glaring else 0],
            corner,
            columns,
            np.float32(exposure.gain * (1.0 - dark)),
            np.float32(exposure.gain * exposure.vignetting),
            np.float32(exposure.offset),
            exposure.noise,
            bits(key, np.uint64(counter) * np.uint64(4096) + np.uint64(y)),
        )


@kernel
def expose(out, row, veil, corner, columns, gain, vignetting, black, sigma, key):  # type: ignore[no-untyped-def]
    """out (w,) uint8 = row · (gain − vignetting · corner) + black, veiled, with noise, rounded and clipped.

    row, veil, corner (w,) float32; columns (w,) uint32: 0, 1, … (taken from memory, they keep the hash in 32
    bits). The noise of standard deviation sigma is the sum of the four bytes of a
    32-bit hash of (key, column), key 64 random bits: mean 0, within 3.45 sigma, excess kurtosis −0.3,
    independent from draw to draw.
    """
    k0, k1 = np.uint32(key & _WORD), np.uint32(key >> np.uint64(32))
    scale = np.float32(sigma / _BYTE_SUM_DEVIATION)
    shift = np.float32(0.5 - _BYTE_SUM_MEAN * sigma / _BYTE_SUM_DEVIATION)
    zero, white, veil_grey = np.float32(0.0), np.float32(255.0), np.float32(_VEIL_GREY)
    for x in range(out.shape[0]):
        h = np.uint32(k0 + columns[x])
        h = np.uint32(h ^ (h >> np.uint32(16)))
        h = np.uint32(times(h, _M1) ^ k1)
        h = np.uint32(h ^ (h >> np.uint32(15)))
        h = times(h, _M2)
        h = np.uint32(h ^ (h >> np.uint32(15)))
        pairs = np.uint32(np.uint32(h & _LOW) + np.uint32((h >> np.uint32(8)) & _LOW))
        total = np.uint32((pairs & np.uint32(0xFFFF)) + (pairs >> np.uint32(16)))
        light = row[x] * (gain - vignetting * corner[x]) + black
        light += veil[x] * (veil_grey - light)
        light += np.float32(np.int32(total)) * scale + shift
        out[x] = np.uint8(np.int32(min(max(light, zero), white)))
