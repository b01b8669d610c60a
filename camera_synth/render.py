"""The road camera of a fleet: 8-bit grey frames from the road, the bodies around, the pose and the day."""

from typing import Any

import numpy as np

from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Projection
from camera_synth.condition import Looks
from camera_synth.pose import Placed
from camera_synth.render_kernels import render_fleet
from camera_synth.truth import BorderColumns, new_border_columns
from sumo_net.road import RoadAhead
from sumo_net.surroundings import Objects

Array = np.ndarray[Any, Any]

NO_TRUTH = np.zeros(0, np.int64), new_border_columns(0)


def new_frames(count: int) -> Array:
    """Black frames for `count` vehicles, (count, 240, 320) uint8."""
    return np.zeros((count, HEIGHT_PX, WIDTH_PX), np.uint8)


def render(
    frames: Array,
    projection: Projection,
    road_ahead: RoadAhead,
    objects: Objects,
    pose: Placed,
    looks: Looks,
    keys: Array,
    frame_counter: Array,
    first_row: int = 0,
    truth: tuple[Array, BorderColumns] = NO_TRUTH,
) -> None:
    """Draw what n vehicles' cameras see into frames (n, 240, 320) uint8; array row = 239 - y.

    keys (n,) uint64: each vehicle's `stream_key(seed, vehicle_id, "camera")`; frame_counter (n,) int64: the
    frame's number, from which noise and slow changes of the exposure follow. Array rows above `first_row` are
    left as they are (PROCESSED_FROM draws what lane detection needs); the others are the same bytes for any
    `first_row`, and for any slicing of the fleet. truth: right slots (n,) int64 and BorderColumns of n lanes,
    which are filled as `truth.border_columns` does, for less than a call of it costs. All arrays
    C-contiguous; releases the GIL.

    Raises ValueError for frames of another shape or a first_row outside them.
    """
    n = len(keys)
    if frames.shape != (n, HEIGHT_PX, WIDTH_PX) or frames.dtype != np.uint8:
        raise ValueError(
            f"frames {frames.dtype} {frames.shape}: uint8 ({n}, {HEIGHT_PX}, {WIDTH_PX}) is needed, as "
            "new_frames makes it"
        )
    if not 0 <= first_row < HEIGHT_PX:
        raise ValueError(f"first_row = {first_row}: allowed are 0 to {HEIGHT_PX - 1}")
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
        truth,
    )
