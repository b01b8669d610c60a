"""What stands and drives around each equipped vehicle, in its own frame."""

from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial import cKDTree

from sumo_net.frames import vehicle_from_world, wrap_angle
from sumo_net.snapshot import Array, Snapshot

REACH_M = 200.0
MAX_OBJECTS = 32


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


class Poses(Protocol):
    """What is needed of the equipped vehicles; EgoTruth has it."""

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

    Equal distances stand in the order of handles, so that the result does not depend on the fleet's order.
    Unused places have handle -1 and NaN elsewhere. A vehicle never sees itself.
    """
    x, y, heading = snapshot.x_m, snapshot.y_m, snapshot.heading_rad
    half = snapshot.length_m / 2.0
    centre_x, centre_y = x - half * np.cos(heading), y - half * np.sin(heading)
    n, count = len(truth.handle), len(snapshot.handle)
    seer = np.isfinite(truth.x_m) & np.isfinite(truth.y_m)
    index = np.full((n, max_objects), -1)
    if count and seer.any():
        tree = cKDTree(np.column_stack([centre_x, centre_y]))
        here = np.column_stack([truth.x_m[seer], truth.y_m[seer]])
        # One more than wanted: the vehicle finds itself, too.
        wanted = min(max_objects + 1, count)
        distance, found = tree.query(here, k=[*range(1, wanted + 1)], distance_upper_bound=reach_m)
        # The tree marks a place that it could not fill with the index `count`.
        handles = np.append(snapshot.handle, np.iinfo(np.int64).max)[found]
        distance = np.where(handles == truth.handle[seer, None], np.inf, distance)
        order = np.lexsort((handles, distance), axis=1)[:, :max_objects]
        found = np.take_along_axis(found, order, axis=1)
        found[np.isinf(np.take_along_axis(distance, order, axis=1))] = -1
        index[seer, : found.shape[1]] = found
    return _objects(truth, snapshot, centre_x, centre_y, index)


def _objects(truth: Poses, snapshot: Snapshot, centre_x: Array, centre_y: Array, index: Array) -> Objects:
    used = index >= 0

    def of(column: Array) -> Array:
        taken = np.full(index.shape, np.nan)
        taken[used] = column[index[used]]
        return taken

    handle = np.full(index.shape, -1, dtype=np.int64)
    handle[used] = snapshot.handle[index[used]]
    # arrays of their own: read-only ones, which n = 1 would give, need another variant of the kernel
    own_x, own_y, own = (
        np.repeat(part[:, None], index.shape[1], axis=1) for part in (truth.x_m, truth.y_m, truth.heading_rad)
    )
    forward, left = vehicle_from_world(
        of(centre_x),
        of(centre_y),
        own_x,
        own_y,
        own,
    )
    return Objects(
        handle=handle,
        forward_m=forward,
        left_m=left,
        heading_rad=wrap_angle(of(snapshot.heading_rad) - own),
        speed_mps=of(snapshot.speed_mps),
        acceleration_mps2=of(snapshot.acceleration_mps2),
        length_m=of(snapshot.length_m),
        width_m=of(snapshot.width_m),
        height_m=of(snapshot.height_m),
    )
