"""Association of detections with tracks: gate and global nearest neighbour, all vehicles at once.

A pair in the gate whose track and detection have no other candidate is taken directly. All others are split
into small dense blocks of a few vehicles each, which scipy solves one after the other: a call's cost depends
on the block, not on the fleet.
"""

from scipy.optimize import linear_sum_assignment

from plugin.tracking.association_kernels import competing
from sumo_net.arrays import Array

NONE = -1
_TRACKS_A_CALL = 16  # after so many a new block begins where possible


def assign(track: Array, detection: Array, distance: Array, detections: int, cost_unassigned: Array) -> Array:
    """The detection (index or -1) of each of T tracks, int64, at minimum total cost.

    Parameters
    ----------
    track, detection, distance : (E,) arrays, the pairs inside the gate, sorted by track, and their squared
        distance.
    cost_unassigned : (T,) array, the cost of leaving a track without detection; at least the gate, so that
        every pair without competitors is taken. Of two competing tracks the one with the larger cost is
        preferred.
    """
    chosen, rows, gains, blocks = competing(
        track, detection, distance, cost_unassigned, detections, _TRACKS_A_CALL
    )
    begin = 0
    for first, count, low, width in blocks.tolist():
        end = begin + count * width
        gain = gains[begin:end].reshape(count, width)
        row, column = linear_sum_assignment(gain, maximize=True)
        taken = gain[row, column] > 0.0
        chosen[rows[first + row[taken]]] = low + column[taken]
        begin = end
    return chosen
