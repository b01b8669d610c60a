"""Octaves worked out on some rows and nodes are the noise itself, evaluated everywhere."""

import numpy as np
import pytest

from camera_synth.camera import Camera, projection
from camera_synth.degrade import NODE_PX, fade, value_noise
from camera_synth.ground_kernels import row_line
from camera_synth.pattern_kernels import NODES, ROOM, STRIDES, Octave, add_octave, ground_of
from camera_synth.surface_kernels import view_of

ROWS = 150
P = projection(Camera())
VIEW = view_of(431.0, -77.0, 0.6, P)


def exact(octave: Octave) -> np.ndarray:
    """Point by point, (ROWS, NODES)."""
    out = np.zeros((ROWS, NODES))
    for y in range(ROWS):
        ahead, depth = row_line(float(y), P)
        footprint = row_line(y + 0.5, P)[0] - row_line(y - 0.5, P)[0]
        for m in range(NODES):
            aside = (P.center_x - NODE_PX * m) * depth / P.focal
            X = VIEW.x + VIEW.cos * ahead - VIEW.sin * aside
            Y = VIEW.y + VIEW.sin * ahead + VIEW.cos * aside
            u, v = octave.u_x * X + octave.u_y * Y, octave.v_x * X + octave.v_y * Y
            out[y, m] = octave.amplitude * fade(octave.wavelength, footprint) * value_noise(u, v, octave.seed)
    return out


@pytest.mark.parametrize(("wavelength", "stride"), [(0.4, 1), (1.6, 2), (6.4, 4), (60.0, 4)])
def test_an_octave_is_the_noise_at_every_node(wavelength: float, stride: int) -> None:
    f = 1.0 / wavelength
    octave = Octave(f, 0.0, 0.0, f, wavelength, stride, 5, 0.7)
    grid = np.full((ROWS, ROOM), 2.0, np.float32)  # added to what is there
    reach = add_octave(grid, ROWS, ground_of(ROWS, P), octave, VIEW, P)
    grid = grid[:, :NODES]
    wanted = exact(octave)
    assert reach == np.count_nonzero(np.abs(wanted).max(axis=1))
    error = grid - 2.0 - wanted
    assert np.sqrt(np.mean(error[:reach] ** 2)) < 0.12 * np.std(wanted[:reach])
    assert np.all(grid[reach:] == 2.0)


def test_an_octave_that_no_row_resolves_is_left_out() -> None:
    grid = np.zeros((ROWS, ROOM), np.float32)
    octave = Octave(50.0, 0.0, 0.0, 50.0, 0.02, 1, 5, 1.0)
    assert add_octave(grid, ROWS, ground_of(ROWS, P), octave, VIEW, P) == 0
    assert not grid.any()


def test_strides_divide_the_row() -> None:
    assert all((NODES - 1) % stride == 0 for stride in STRIDES)
