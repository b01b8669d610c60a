"""Where the fleet is in the world, as the camera needs it."""

from typing import Any, NamedTuple, Protocol

import numpy as np

Array = np.ndarray[Any, Any]


class Pose(NamedTuple):
    """Where n vehicles' centres of gravity are in the world, (n,) each."""

    x_m: Array
    y_m: Array
    heading_rad: Array  # counter-clockwise from +x


class Placed(Protocol):
    """What is needed of the vehicles: a Pose has it, and so has sumo_net.ego.EgoTruth."""

    @property
    def x_m(self) -> Array:
        """(n,) centre of gravity, world."""

    @property
    def y_m(self) -> Array:
        """(n,)."""

    @property
    def heading_rad(self) -> Array:
        """(n,) counter-clockwise from +x."""
