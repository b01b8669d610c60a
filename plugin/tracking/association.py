"""Which detection belongs to which track: gate and global nearest neighbour, all vehicles at once.

A pair in the gate whose track and detection both have no other candidate is taken as it is. All the others,
of all vehicles, form one sparse assignment problem that falls apart into small blocks; scipy solves it in
calls of some hundred tracks each (its time grows with the square of their number).
"""

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from plugin.tracking.detections import Array

NONE = -1
_TRACKS_A_CALL = 400


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
    chosen = np.full(tracks, NONE, np.int64)
    alone = np.bincount(track, minlength=tracks)[track] == 1
    alone &= np.bincount(detection, minlength=detections)[detection] == 1
    chosen[track[alone]] = detection[alone]
    if alone.all():
        return chosen
    track, detection, distance = track[~alone], detection[~alone], distance[~alone]
    begin = 0
    for end in _ends(track, detection):
        part = slice(begin, end)
        _assign_block(track[part], detection[part], distance[part], cost_unassigned, chosen)
        begin = end
    return chosen


def _ends(track: Array, detection: Array) -> Array:
    """Where to cut the pairs, sorted by track, no track or detection being on both sides of a cut."""
    before = np.maximum.accumulate(detection)[:-1]
    after = np.minimum.accumulate(detection[::-1])[::-1][1:]
    cuts = np.append(np.flatnonzero((before < after) & (track[:-1] != track[1:])) + 1, len(track))
    first = np.concatenate([[True], track[1:] != track[:-1]])
    call = np.cumsum(first)[cuts - 1] // _TRACKS_A_CALL
    return cuts[np.append(call[1:] != call[:-1], True)]


def _assign_block(
    track: Array, detection: Array, distance: Array, cost_unassigned: Array, chosen: Array
) -> None:
    """Solve one block and write its detections into `chosen`."""
    rows, row = np.unique(track, return_inverse=True)
    columns, column = np.unique(detection, return_inverse=True)
    # Every track may also take a column of its own: "no detection". 1 keeps every weight off zero, which a
    # sparse matrix would not hold; as every row is matched once it changes nothing.
    own = np.arange(len(rows))
    order = np.argsort(np.concatenate([row, own]), kind="stable")
    weights = csr_array(
        (
            (1.0 + np.concatenate([distance, cost_unassigned[rows]]))[order],
            np.concatenate([column, len(columns) + own])[order],
            np.concatenate([[0], np.cumsum(np.bincount(row) + 1)]),
        ),
        shape=(len(rows), len(columns) + len(rows)),
    )
    matched_row, matched_column = min_weight_full_bipartite_matching(weights)
    real = matched_column < len(columns)
    chosen[rows[matched_row[real]]] = columns[matched_column[real]]
