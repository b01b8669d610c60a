"""The road camera of a fleet: 8-bit grey frames from the road, the bodies around, the pose and the day."""

from typing import Any, NamedTuple

import numpy as np

from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Projection
from camera_synth.condition import Looks
from camera_synth.render_kernels import render_fleet
from sumo_net.road import RoadAhead
from sumo_net.surroundings import Objects

Array = np.ndarray[Any, Any]

PROCESSED_ROWS = 150  # from the bottom up; what lane detection looks at
PROCESSED_FROM = HEIGHT_PX - PROCESSED_ROWS  # the array row where they begin


class Pose(NamedTuple):
    """Where n vehicles' centres of gravity are in the world, (n,) each."""

    x_m: Array
    y_m: Array
    heading_rad: Array  # counter-clockwise from +x


def new_frames(count: int) -> Array:
    """Black frames for `count` vehicles, (count, 240, 320) uint8."""
    return np.zeros((count, HEIGHT_PX, WIDTH_PX), np.uint8)


def render(
    frames: Array,
    projection: Projection,
    road_ahead: RoadAhead,
    objects: Objects,
    pose: Pose,
    looks: Looks,
    keys: Array,
    frame_counter: Array,
    first_row: int = 0,
) -> None:
    """Draw what n vehicles' cameras see into frames (n, 240, 320) uint8; array row = 239 - y.

    keys (n,) uint64: each vehicle's `stream_key(seed, vehicle_id, "camera")`; frame_counter (n,) int64: the
    frame's number, from which noise and slow changes of the exposure follow. Array rows above `first_row` are
    left as they are (PROCESSED_FROM draws what lane detection needs); the others are the same bytes for any
    `first_row`, and for any slicing of the fleet. All arrays C-contiguous; releases the GIL.
    """
    render_fleet(
        frames,
        first_row,
        projection,
        road_ahead,
        objects,
        pose.x_m,
        pose.y_m,
        pose.heading_rad,
        looks,
        keys,
        frame_counter,
    )
