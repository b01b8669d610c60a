"""Patterns on the ground as a camera sees them: octaves of smooth noise on a grid of rows and nodes.

An octave is evaluated on rows a SAMPLES-th of its wavelength apart on the ground, at every `stride`-th node,
and interpolated linearly between them. Near the vehicle, where a row spans a few centimetres, that saves most
evaluations of long waves.
"""

from typing import NamedTuple

import numpy as np

from camera_synth.camera import WIDTH_PX
from camera_synth.degrade import NODE_PX, fade, noise_line
from camera_synth.ground_kernels import VECTOR, row_line
from sumo_net.compile import inlined, kernel

NODES = WIDTH_PX // NODE_PX + 1  # of a row
ROOM = VECTOR * ((NODES + VECTOR - 1) // VECTOR)  # the same, rounded up to whole vectors
SAMPLES = 6.0  # least number of rows per wavelength, where the image has as many
STRIDES = (1, 2, 4)  # of nodes


class Octave(NamedTuple):
    """One octave: noise at the lattice point (u_x X + u_y Y, v_x X + v_y Y) of a world point (X, Y)."""

    u_x: float  # 1/m
    u_y: float
    v_x: float
    v_y: float
    wavelength: float  # m, the shortest; rows that span more than half of it have none of the octave
    stride: int  # of STRIDES
    seed: int
    amplitude: float


class Ground(NamedTuple):
    """The ground distances of one camera's image rows, the same for every vehicle."""

    ahead: np.ndarray  # (rows,) m from the camera to the middle of a row
    footprint: np.ndarray  # (rows,) m of ahead that a row spans
    node: np.ndarray  # (ROOM,) float32 scratch
    low: np.ndarray  # the same
    high: np.ndarray  # the same


@kernel
def ground_of(rows, p):  # type: ignore[no-untyped-def]
    """The Ground of the lowest `rows` rows."""
    ahead, footprint = np.empty(rows), np.empty(rows)
    for y in range(rows):
        below, _ = row_line(y - 0.5, p)
        above, _ = row_line(y + 0.5, p)
        ahead[y], _ = row_line(np.float64(y), p)
        footprint[y] = above - below
    return Ground(
        ahead,
        footprint,
        np.zeros(ROOM, np.float32),
        np.zeros(ROOM, np.float32),
        np.zeros(ROOM, np.float32),
    )


@kernel
def add_octave(grid, rows, ground, octave, view, p):  # type: ignore[no-untyped-def]
    """grid[y] += amplitude · N on the lowest `rows` rows; returns the number of rows with the octave.

    grid (rows, ROOM) float32. The octave fades out where a row spans more than a quarter of its wavelength.
    """
    ahead, footprint, wavelength = ground.ahead, ground.footprint, octave.wavelength
    reach = 0
    while reach < rows and footprint[reach] < 0.5 * wavelength:
        reach += 1
    if reach == 0:
        return reach
    farthest = wavelength / SAMPLES
    near = 0
    low, high = ground.low, ground.high
    _noise_row(low, ground.node, ahead[0], octave, view, p)
    _add_between(grid[0], low, low, octave.amplitude * fade(wavelength, footprint[0]), 0.0)
    while near < reach - 1:
        far = near + 1
        while far < reach - 1 and ahead[far + 1] - ahead[near] <= farthest:
            far += 1
        _noise_row(high, ground.node, ahead[far], octave, view, p)
        whole = 1.0 / (ahead[far] - ahead[near])
        for y in range(near + 1, far + 1):
            strength = octave.amplitude * fade(wavelength, footprint[y])
            share = (ahead[y] - ahead[near]) * whole * strength
            _add_between(grid[y], low, high, strength - share, share)
        near = far
        low, high = high, low
    return reach


@inlined
def _noise_row(out, node, ahead, octave, view, p):  # type: ignore[no-untyped-def]
    """The octave at the nodes of the ground line `ahead` metres from the camera; `node` is scratch."""
    stride = octave.stride
    depth = p.cos_pitch * ahead + p.sin_pitch * p.height
    aside, step = p.center_x * depth / p.focal, -depth / p.focal * (NODE_PX * stride)
    x = view.x + view.cos * ahead - view.sin * aside
    y = view.y + view.sin * ahead + view.cos * aside
    dx, dy = -view.sin * step, view.cos * step
    u, v = octave.u_x * x + octave.u_y * y, octave.v_x * x + octave.v_y * y
    du, dv = octave.u_x * dx + octave.u_y * dy, octave.v_x * dx + octave.v_y * dy
    if stride == 1:
        noise_line(out, u, v, du, dv, octave.seed)
        return
    some = node[: VECTOR * ((ROOM // stride + VECTOR - 1) // VECTOR)]
    noise_line(some, u, v, du, dv, octave.seed)
    part, two, three = np.float32(1.0 / stride), np.float32(2.0), np.float32(3.0)
    if stride == 2:
        for m in range(ROOM // 2 - 1):
            at, rise = some[m], (some[m + 1] - some[m]) * part
            out[2 * m], out[2 * m + 1] = at, at + rise
    else:
        for m in range(ROOM // 4 - 1):
            at, rise = some[m], (some[m + 1] - some[m]) * part
            out[4 * m], out[4 * m + 1] = at, at + rise
            out[4 * m + 2], out[4 * m + 3] = at + two * rise, at + three * rise


@inlined
def _add_between(out, low, high, share_low, share_high):  # type: ignore[no-untyped-def]
    a, b = np.float32(share_low), np.float32(share_high)
    for m in range(ROOM):
        out[m] += a * low[m] + b * high[m]
