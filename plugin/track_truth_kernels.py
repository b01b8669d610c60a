"""Kernel of the tracks' truth: which of the bodies around is a track's."""

import numpy as np

from sumo_net.compile import kernel


@kernel
def places(owner, target, handle):  # type: ignore[no-untyped-def]
    """Column in handle (n, M) of the body target (T,) in row owner (T,); -1 where it is not there."""
    out = np.full(len(owner), -1)
    for t in range(len(owner)):
        for m in range(handle.shape[1]):
            if handle[owner[t], m] == target[t]:
                out[t] = m
                break
    return out
