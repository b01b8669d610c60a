"""The true borders of a lane in the image, for evaluating lane detection."""

from typing import NamedTuple

import numpy as np

from camera_synth.camera import PROCESSED_ROWS, WIDTH_PX, Projection
from camera_synth.condition import Looks
from camera_synth.pose import Pose
from camera_synth.truth_kernels import locate_borders
from sumo_net.arrays import Array
from sumo_net.road import RoadAhead
from sumo_net.surroundings import Objects


class BorderColumns(NamedTuple):
    """Borders of n lanes in image rows y = 0 … rows - 1 (from the bottom); index 0 left, 1 right."""

    column: Array  # (n, 2, rows) of the line's centre; NaN without marking, outside the image, behind a body
    painted: Array  # (n, 2, rows) bool: solid line or stroke of a dash, with at least a quarter of its paint


def new_border_columns(count: int, rows: int = PROCESSED_ROWS) -> BorderColumns:
    """BorderColumns of `count` lanes, all NaN."""
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
    """The borders of the lane whose right border is in slot `right_slot` (n,) of each RoadAhead.

    For the vehicle's own lane, that is road.OWN_RIGHT + EgoTruth.lanes_left. The geometry is that of
    `render`, at the rows' centres. `pose` locates the wear of the paint. All arrays C-contiguous.
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
