"""The true borders of a lane in the image, to judge lane detection by."""

from typing import NamedTuple

import numpy as np

from camera_synth.camera import PROCESSED_ROWS, WIDTH_PX, Projection
from camera_synth.condition import Looks
from camera_synth.pose import Pose
from camera_synth.truth_kernels import locate_borders
from sumo_net.road import Array, RoadAhead
from sumo_net.surroundings import Objects


class BorderColumns(NamedTuple):
    """Where n lanes' borders are in image rows y = 0 … rows - 1 (from the bottom); index 0 left, 1 right."""

    column: Array  # (n, 2, rows) of the line's centre; NaN without marking, outside the image, behind a body
    painted: Array  # (n, 2, rows) bool: in a solid line or a dash's stroke, with a quarter of its paint left


def new_border_columns(count: int, rows: int = PROCESSED_ROWS) -> BorderColumns:
    """BorderColumns of `count` lanes that are nowhere."""
    return BorderColumns(np.full((count, 2, rows), np.nan), np.zeros((count, 2, rows), np.bool_))


def border_columns(
    projection: Projection,
    road_ahead: RoadAhead,
    objects: Objects,
    right_slot: Array,
    looks: Looks,
    pose: Pose,
    rows: int = PROCESSED_ROWS,
) -> BorderColumns:
    """The borders of the lane whose right border stands in slot `right_slot` (n,) of each RoadAhead.

    For the lane that holds the vehicle that is road.OWN_RIGHT + EgoTruth.lanes_left. The same geometry as
    render's, at the rows' middles; wear stands in the world, hence `pose`. All arrays C-contiguous.
    """
    n = len(right_slot)
    truth = new_border_columns(n, rows)
    slots = np.ascontiguousarray(right_slot, np.int64)
    locate_borders(
        truth.column,
        truth.painted,
        WIDTH_PX,
        projection,
        road_ahead,
        objects,
        slots,
        looks,
        pose.x_m,
        pose.y_m,
        pose.heading_rad,
    )
    return truth
