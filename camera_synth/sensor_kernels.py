"""From the light on a row to 8-bit grey: exposure, vignetting, veiling glare, noise."""

import math
from typing import NamedTuple

import numpy as np

from camera_synth.camera import WIDTH_PX
from camera_synth.degrade import NODE_PX, interpolate, smooth_walk, times
from sumo_net.arrays import Array
from sumo_net.compile import inlined, kernel
from sumo_net.randomness import bits

_VEIL_GREY = 235.0
_M1, _M2 = np.uint32(0x21F0AAAD), np.uint32(0x735A2D97)
_LOW, _ABOVE = np.uint32(0x00FF00FF), np.uint32(0x01000100)
_WORD = np.uint64(0xFFFFFFFF)
_QUARTER = WIDTH_PX // 4
_BYTES = 256
_BYTE_SUM_MEAN, _BYTE_SUM_DEVIATION = 510, 147.79885  # of four independent bytes: sqrt(4 (2¹⁶ − 1) / 12)


class Exposure(NamedTuple):
    """Exposure of one frame of one vehicle's camera."""

    gain: float
    offset: float  # grey levels
    vignetting: float  # share of the light lost in the corners
    glare: float  # share of the contrast lost at the sun's position
    sun_x: float  # px
    sun_y: float
    noise: float  # standard deviation, grey levels


class Lens(NamedTuple):
    """Constants of all frames, and scratch for a row."""

    columns: Array  # (WIDTH_PX,) uint32: 0, 1, …
    corner: Array  # (WIDTH_PX,) float32, squared distance from the middle column, 1 in the corners
    node: Array  # (WIDTH_PX / NODE_PX + 1,) float32 scratch
    veil: Array  # (WIDTH_PX,) float32, of glare
    gain: Array  # the same, of a row
    black: Array  # the same


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
def new_lens(height):  # type: ignore[no-untyped-def]
    """The Lens of an image of `height` rows."""
    columns, corner = np.zeros(WIDTH_PX, np.uint32), np.zeros(WIDTH_PX, np.float32)
    for x in range(WIDTH_PX):
        columns[x] = x
        corner[x] = (2.0 * x - WIDTH_PX) ** 2 / (WIDTH_PX**2 + height**2)
    return Lens(
        columns,
        corner,
        np.zeros(WIDTH_PX // NODE_PX + 1, np.float32),
        np.zeros(WIDTH_PX, np.float32),
        np.zeros(WIDTH_PX, np.float32),
        np.zeros(WIDTH_PX, np.float32),
    )


@inlined
def read_out(frame, canvas, first, end, lens, exposure, key, counter):  # type: ignore[no-untyped-def]
    """Rows `first` to `end` - 1 of frame (height, width) uint8, number `counter`, from their light.

    The noise's counter reserves 2¹² rows per frame.
    """
    height = frame.shape[0]
    node, veil, gain, black = lens.node, lens.veil, lens.gain, lens.black
    lost = np.float32(exposure.gain * exposure.vignetting)
    one, half, grey = np.float32(1.0), np.float32(0.5), np.float32(_VEIL_GREY)
    offset, sun_x = np.float32(exposure.offset), np.float32(exposure.sun_x)
    everywhere, near_sun = np.float32(0.45 * exposure.glare), np.float32(0.55 * exposure.glare)
    for x in range(WIDTH_PX):
        black[x] = offset + half  # rounded
    for y in range(first, end):
        dark = exposure.vignetting * (2.0 * y - height) ** 2 / (WIDTH_PX**2 + height**2)
        middle = np.float32(exposure.gain * (1.0 - dark))
        for x in range(WIDTH_PX):
            gain[x] = middle - lost * lens.corner[x]
        if exposure.glare > 0.0:
            rise = np.float32((y - exposure.sun_y) ** 2)
            for m in range(node.shape[0]):
                aside = np.float32(np.int32(NODE_PX * m)) - sun_x
                away = aside * aside + rise
                node[m] = everywhere + near_sun / (one + away * np.float32(1.0 / 140.0**2))
            interpolate(node, veil)
            for x in range(WIDTH_PX):
                gain[x] *= one - veil[x]
                black[x] = (offset + half) + veil[x] * (grey - offset)
        noise_key = bits(key, np.uint64(counter) * np.uint64(4096) + np.uint64(y))
        expose(frame[height - 1 - y], canvas[y - first], gain, black, lens.columns, exposure.noise, noise_key)


@kernel
def expose(out, row, gain, black, columns, sigma, key):  # type: ignore[no-untyped-def]
    """out (w,) uint8 = row · gain + black, with noise, rounded and clipped; w = WIDTH_PX.

    row, gain, black (w,) float32; columns (w,) uint32: 0, 1, … (read from memory, so that the hash stays in
    32 bits). The noise, of standard deviation sigma, is a sum of four bytes less its mean: mean 0, within
    3.45 sigma, excess kurtosis −0.3, independent between frames and rows. Four columns, a quarter of the row
    apart, share the bytes of a 32-bit hash of (key, column), key: 64 random bits. Each sums them with the
    signs of another row of a Hadamard matrix: uncorrelated, but their squares are not (−0.18).
    """
    k0, k1 = np.uint32(key & _WORD), np.uint32(key >> np.uint64(32))
    scale = np.float32(sigma / _BYTE_SUM_DEVIATION)
    low, mean, above = np.uint32(0xFFFF), np.int32(_BYTE_SUM_MEAN), np.int32(2 * _BYTES)
    for x in range(_QUARTER):
        h = np.uint32(k0 + columns[x])
        h = np.uint32(h ^ (h >> np.uint32(16)))
        h = np.uint32(times(h, _M1) ^ k1)
        h = np.uint32(h ^ (h >> np.uint32(15)))
        h = times(h, _M2)
        h = np.uint32(h ^ (h >> np.uint32(15)))
        even, odd = np.uint32(h & _LOW), np.uint32((h >> np.uint32(8)) & _LOW)
        more = np.uint32(even + odd)  # two sums of two bytes
        less = np.uint32(np.uint32(even | _ABOVE) - odd)  # their differences, and 256
        a, b = np.int32(more & low), np.int32(more >> np.uint32(16))
        c, d = np.int32(less & low), np.int32(less >> np.uint32(16))
        out[x] = _level(row[x] * gain[x] + black[x], np.int32(a + b - mean), scale)
        x += _QUARTER
        out[x] = _level(row[x] * gain[x] + black[x], np.int32(a - b), scale)
        x += _QUARTER
        out[x] = _level(row[x] * gain[x] + black[x], np.int32(c + d - above), scale)
        x += _QUARTER
        out[x] = _level(row[x] * gain[x] + black[x], np.int32(c - d), scale)


@kernel
def _level(light, bytes_sum, scale):  # type: ignore[no-untyped-def]
    light += np.float32(bytes_sum) * scale
    return np.uint8(np.int32(min(max(light, np.float32(0.0)), np.float32(255.0))))
