"""All vehicles of a simulation at one time, as columns."""

from typing import NamedTuple

from sumo_net.arrays import Array


class Snapshot(NamedTuple):
    """All N vehicles at one time, ordered by handle.

    A teleporting vehicle has no position and is left out; a parked one has lane -1 and NaN for
    `lane_position_m`.
    """

    handle: Array  # (N,) int64, number given to a vehicle when it enters, never reused
    x_m: Array  # centre of the front bumper, world (SUMO position)
    y_m: Array
    heading_rad: Array  # counter-clockwise from +x, in [-pi, pi)
    speed_mps: Array
    lane: Array  # int32 index into Traffic.lane_ids, -1 when on none
    lane_position_m: Array  # front bumper along SUMO's lane
    length_m: Array
    width_m: Array
    height_m: Array
