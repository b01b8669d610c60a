"""The road camera of a fleet: 8-bit grey frames from the road, the bodies around, the pose and the day."""

from typing import Any, NamedTuple, Protocol

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
) -> None:
    """Draw what n vehicles' cameras see into frames (n, 240, 320) uint8; array row = 239 - y.

    keys (n,) uint64: each vehicle's `stream_key(seed, vehicle_id, "camera")`; frame_counter (n,) int64: the
    frame's number, from which noise and slow changes of the exposure follow. Array rows above `first_row` are
    left as they are (PROCESSED_FROM draws what lane detection needs); the others are the same bytes for any
    `first_row`, and for any slicing of the fleet. All arrays C-contiguous; releases the GIL.

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
    )
