"""Planar frames: angle wrapping, SUMO's angles, and the vehicle frame of ISO 8855.

World: x east, y north, headings counter-clockwise from +x. Vehicle: x forward, y left, origin at the centre
of gravity. SUMO: angles in degrees clockwise from north, position of a vehicle = centre of its front bumper.

Everything here is a compiled kernel that takes scalars or arrays of one shape (float64), so it serves other
kernels and numpy code alike. Transforms are named `target_from_source`.
"""

import math

import numpy as np

from sumo_net.compile import kernel

_TURN = 2.0 * math.pi


@kernel
def wrap_angle(angle):  # type: ignore[no-untyped-def]
    """The same angle in [-π, π), rad (rounding may give +π for an angle just below an odd multiple)."""
    return angle - _TURN * np.floor((angle + math.pi) / _TURN)


@kernel
def heading_from_sumo_angle(angle_deg):  # type: ignore[no-untyped-def]
    """Heading in rad, [-π, π), of SUMO's angle in degrees clockwise from north."""
    return wrap_angle(math.pi / 2.0 - angle_deg * (math.pi / 180.0))


@kernel
def vehicle_from_world(x, y, origin_x, origin_y, heading):  # type: ignore[no-untyped-def]
    """(forward, left) of a world point for a vehicle whose centre of gravity is at the origin given."""
    dx, dy = x - origin_x, y - origin_y
    c, s = np.cos(heading), np.sin(heading)
    return c * dx + s * dy, c * dy - s * dx
