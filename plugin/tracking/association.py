"""Which detection belongs to which track: gate and global nearest neighbour, all vehicles at once."""

import numpy as np

from plugin.tracking import association_kernels as kernels
from plugin.tracking.detections import Array

NONE = -1


def assign(
    track: Array, detection: Array, distance: Array, tracks: int, detections: int, cost_unassigned: Array
) -> Array:
    """The detection (index or -1) of each track, (tracks,) int64, at the least total cost.

    Parameters
    ----------
    track, detection, distance : (E,) arrays, the pairs inside the gate, sorted by track, and their squared
        distance.
    cost_unassigned : (tracks,) array, the cost of leaving a track without detection; at least the gate, so
        that no pair in the gate is left out where nothing competes. The track with the larger cost goes first
        where two compete.
    """
    chosen = kernels.assign(track, detection, distance, tracks, detections, cost_unassigned)
    return np.asarray(chosen)
