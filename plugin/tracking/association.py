"""Which detection belongs to which track: gate and global nearest neighbour, all vehicles at once.

A pair in the gate whose track and detection both have no other candidate is taken as it is. All the others,
of all vehicles, form one sparse assignment problem that falls apart into small blocks by itself; scipy
solves it in one call.
"""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from plugin.tracking.detections import Array

NONE = -1


def assign(
    track: Array, detection: Array, distance: Array, tracks: int, detections: int, cost_unassigned: Array
) -> Array:
    """The detection (index or -1) of each track, (tracks,) int64, at the least total cost.

    Parameters
    ----------
    track, detection, distance : (E,) arrays, the pairs inside the gate and their squared distance.
    cost_unassigned : (tracks,) array, the cost of leaving a track without detection; at least the gate, so
        that no pair in the gate is left out where nothing competes. The track with the larger cost goes first
        where two compete.
    """
    chosen = np.full(tracks, NONE, np.int64)
    alone = np.bincount(track, minlength=tracks)[track] == 1
    alone &= np.bincount(detection, minlength=detections)[detection] == 1
    chosen[track[alone]] = detection[alone]
    if alone.all():
        return chosen
    track, detection, distance = track[~alone], detection[~alone], distance[~alone]
    rows, row = np.unique(track, return_inverse=True)
    columns, column = np.unique(detection, return_inverse=True)
    # Every track may also take a column of its own: "no detection". 1 keeps every weight off zero, which a
    # sparse matrix would not hold; as every row is matched once it changes nothing.
    own = np.arange(len(rows))
    weights = csr_array(
        (
            1.0 + np.concatenate([distance, cost_unassigned[rows]]),
            (np.concatenate([row, own]), np.concatenate([column, len(columns) + own])),
        ),
        shape=(len(rows), len(columns) + len(rows)),
    )
    matched_row, matched_column = min_weight_full_bipartite_matching(weights)
    real = matched_column < len(columns)
    chosen[rows[matched_row[real]]] = columns[matched_column[real]]
    return chosen
