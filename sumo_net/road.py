"""The smooth road of lane paths, from any SUMO lane shapes: pose, curvature, borders at a station."""

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]

MAX_BORDERS = 8  # marking lines across a carriageway that are described
NO_MARKING, SOLID, DASHED = 0, 1, 2  # border kinds


class RoadAhead(NamedTuple):
    """The road in front of n vehicles, sampled at J stations along the lane path, in the vehicle frame.

    The path is the centre line of SUMO's lane that the vehicle is in (and of the lanes that follow it on the
    vehicle's route). Where the path ends, `forward_m` and what follows are NaN.
    """

    station_m: Array  # (n, J) along the edge, the same for every vehicle that sees the place (dash phase)
    forward_m: Array  # (n, J) path centre line
    left_m: Array  # (n, J)
    heading_rad: Array  # (n, J) of the path minus the vehicle's
    curvature_1pm: Array  # (n, J) of the path
    border_offset_m: Array  # (n, J, MAX_BORDERS) left of the path, from right to left; NaN for unused
    border_kind: Array  # (n, J, MAX_BORDERS) int8
    road_right_m: Array  # (n, J) edges of the asphalt, left of the path (the right one is negative)
    road_left_m: Array  # (n, J)
