"""Poses of the fleet's vehicles in the world."""

from typing import NamedTuple, Protocol

from sumo_net.arrays import Array


class Pose(NamedTuple):
    """World poses of n vehicles' centres of gravity, (n,) each."""

    x_m: Array
    y_m: Array
    heading_rad: Array  # counter-clockwise from +x


class Placed(Protocol):
    """World poses of n vehicles; Pose and sumo_net.ego.EgoTruth have them."""

    @property
    def x_m(self) -> Array:
        """(n,) centre of gravity, world."""

    @property
    def y_m(self) -> Array:
        """(n,)."""

    @property
    def heading_rad(self) -> Array:
        """(n,) counter-clockwise from +x."""
