"""Vehicles and roadside objects around each equipped vehicle, in its own frame."""

from typing import NamedTuple, Protocol

import numpy as np

from sumo_net.arrays import Array
from sumo_net.snapshot import Snapshot
from sumo_net.surroundings_kernels import around

REACH_M = 200.0
MAX_OBJECTS = 32


class Objects(NamedTuple):
    """The M nearest bodies of each of n vehicles, in the ISO vehicle frame (origin: centre of gravity).

    Vehicles and roadside objects are boxes alike. In unused slots `handle` is -1, all else NaN.
    """

    handle: Array  # (n, M) int64: Traffic's handle of a vehicle; below -1 for roadside objects; -1: unused
    forward_m: Array  # (n, M) centre of the body
    left_m: Array
    heading_rad: Array  # relative to the vehicle's
    speed_mps: Array  # along its own heading, over ground
    length_m: Array
    width_m: Array
    height_m: Array


class Poses(Protocol):
    """The poses of the equipped vehicles; EgoTruth has them."""

    @property
    def handle(self) -> Array:
        """(n,) int64."""

    @property
    def x_m(self) -> Array:
        """(n,) centre of gravity, world."""

    @property
    def y_m(self) -> Array:
        """(n,)."""

    @property
    def heading_rad(self) -> Array:
        """(n,) counter-clockwise from +x."""


def objects_around(
    truth: Poses, snapshot: Snapshot, reach_m: float = REACH_M, max_objects: int = MAX_OBJECTS
) -> Objects:
    """The other vehicles whose centres are within `reach_m` of the n centres of gravity, nearest first.

    Equal distances are ordered by handle, so that the result does not depend on the fleet's order. Unused
    slots have handle -1 and NaN elsewhere. A vehicle itself is left out.
    """
    half = snapshot.length_m / 2.0
    centre_x = snapshot.x_m - half * np.cos(snapshot.heading_rad)
    centre_y = snapshot.y_m - half * np.sin(snapshot.heading_rad)
    shape = len(truth.handle), max_objects
    found = Objects(np.empty(shape, np.int64), *(np.empty(shape) for _ in Objects._fields[1:]))
    around(
        truth.handle, truth.x_m, truth.y_m, truth.heading_rad, snapshot, centre_x, centre_y, reach_m, found
    )
    return found
