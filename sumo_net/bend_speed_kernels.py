"""Speed limits that follow from the bends ahead."""

import math

import numpy as np

from sumo_net.compile import kernel
from sumo_net.road_kernels import path_length, pose_at


@kernel
def bend_speeds(table, path, station, speed, lateral, braking):  # type: ignore[no-untyped-def]
    """Highest speed (n,) in m/s from which braking at `braking` still meets the limit of every bend ahead.

    Minimum over distances s ahead of √(lateral / |κ(s)| + 2 · braking · s), up to the stopping distance;
    infinite on a straight road.
    """
    n = len(path)
    most = np.full(n, np.inf)
    for i in range(n):
        reach = min(0.5 * speed[i] ** 2 / braking + speed[i], path_length(table, path[i]) - station[i])
        ahead = 0.0
        while ahead <= reach:
            curvature = abs(pose_at(table, path[i], station[i] + ahead)[3])
            if curvature > 1e-6:
                allowed = math.sqrt(lateral / curvature + 2.0 * braking * ahead)
                most[i] = min(most[i], allowed)
            ahead += 0.5
    return most
