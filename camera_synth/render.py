"""The road camera of a fleet: 8-bit grey frames from road, surrounding bodies, pose and conditions."""

import numpy as np

from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Projection
from camera_synth.condition import Looks
from camera_synth.pose import Placed
from camera_synth.render_kernels import render_fleet
from camera_synth.truth import BorderColumns, new_border_columns
from sumo_net.arrays import Array
from sumo_net.road import RoadAhead
from sumo_net.surroundings import Objects

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
    """Render the camera images of n vehicles into frames (n, 240, 320) uint8; array row = 239 - y.

    keys (n,) uint64: each vehicle's `stream_key(seed, vehicle_id, "camera")`; frame_counter (n,) int64:
    number of the frame, which determines its noise and exposure drift. Array rows above `first_row` are not
    written (PROCESSED_FROM renders what lane detection needs); the others are the same bytes for any
    `first_row` and any slicing of the fleet. truth: right slots (n,) int64 and BorderColumns of n lanes,
    filled as by `truth.border_columns`, at less cost. All arrays C-contiguous; releases the GIL.

    Raises ValueError for frames of another shape or a first_row outside them.
    """
    n = len(keys)
    if frames.shape != (n, HEIGHT_PX, WIDTH_PX) or frames.dtype != np.uint8:
        raise ValueError(
            f"frames {frames.dtype} {frames.shape}: must be uint8 ({n}, {HEIGHT_PX}, {WIDTH_PX}), as from "
            "new_frames"
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
