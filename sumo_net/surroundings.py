"""What stands and drives around each equipped vehicle, in its own frame."""

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray[Any, Any]


class Objects(NamedTuple):
    """The M nearest bodies of each of n vehicles, ISO vehicle frame (origin centre of gravity); unused = -1.

    Vehicles and roadside objects alike: a body is a box.
    """

    handle: Array  # (n, M) int64: Traffic's number of the vehicle, roadside objects below -1, -1 for unused
    forward_m: Array  # (n, M) centre of the body
    left_m: Array
    heading_rad: Array  # relative to the vehicle's
    speed_mps: Array  # along its own heading, over ground
    acceleration_mps2: Array
    length_m: Array
    width_m: Array
    height_m: Array
