"""The bodies nearest to each vehicle, in its own frame."""

import math

import numpy as np

from sumo_net.compile import kernel
from sumo_net.frames import vehicle_from_world, wrap_angle

_UNUSED = -1


@kernel
def around(handle, x, y, heading, snapshot, centre_x, centre_y, reach, out):  # type: ignore[no-untyped-def]
    """Fill Objects `out` of n vehicles with the others of a Snapshot; see surroundings.objects_around.

    Every vehicle is compared with every other, which is faster than a tree for hundreds of vehicles.
    """
    most = out.handle.shape[1]
    square, nearest = np.zeros(centre_x.shape[0]), np.zeros(most)
    index = np.zeros(most, np.int64)
    for i in range(handle.shape[0]):
        for k in range(square.shape[0]):
            dx, dy = centre_x[k] - x[i], centre_y[k] - y[i]
            square[k] = dx * dx + dy * dy
        found, limit = 0, reach * reach
        for k in range(square.shape[0]):
            if not square[k] <= limit or square[k] >= reach * reach or snapshot.handle[k] == handle[i]:
                continue
            at = found
            while at > 0 and (
                square[k] < nearest[at - 1]
                or (square[k] == nearest[at - 1] and snapshot.handle[k] < snapshot.handle[index[at - 1]])
            ):
                if at < most:
                    nearest[at], index[at] = nearest[at - 1], index[at - 1]
                at -= 1
            if at < most:
                nearest[at], index[at] = square[k], k
                found = min(found + 1, most)
            if found == most:
                limit = nearest[most - 1]
        for m in range(most):
            if m >= found:
                out.handle[i, m] = _UNUSED
                out.forward_m[i, m] = out.left_m[i, m] = out.heading_rad[i, m] = math.nan
                out.speed_mps[i, m] = out.length_m[i, m] = out.width_m[i, m] = out.height_m[i, m] = math.nan
                continue
            k = index[m]
            out.handle[i, m] = snapshot.handle[k]
            out.forward_m[i, m], out.left_m[i, m] = vehicle_from_world(
                centre_x[k], centre_y[k], x[i], y[i], heading[i]
            )
            out.heading_rad[i, m] = wrap_angle(snapshot.heading_rad[k] - heading[i])
            out.speed_mps[i, m] = snapshot.speed_mps[k]
            out.length_m[i, m] = snapshot.length_m[k]
            out.width_m[i, m] = snapshot.width_m[k]
            out.height_m[i, m] = snapshot.height_m[k]
