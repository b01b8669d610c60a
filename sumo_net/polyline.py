"""Polylines: points (P, 2) of x and y."""

import numpy as np

from sumo_net.arrays import Array


def stations(points: Array) -> Array:
    """The way (P,) along the line from its first point to each."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
