"""The rear of the vehicle ahead in the camera's frames: the columns of its sides, and so its width.

The width in the image is inversely proportional to the distance and independent of the own pitch: braking
shifts a body's foot by many pixels, but does not change its width. A body is first found by the dark strip
at its foot, later where its sides were in the frame before.
"""

from typing import NamedTuple

import numpy as np

from camera_synth.camera import Projection
from plugin.tracking.rear_kernels import look_fleet, moved_sides
from sumo_net.arrays import Array

NOBODY = -1


class Watched(NamedTuple):
    """The body that each of n cameras looks for in its next frame, (n,) each."""

    track_id: Array  # int64, -1 for none
    x_m: Array  # its nearest point expected then, from the centre of gravity
    y_m: Array
    left_px: Array  # expected columns of its sides; NaN if not seen recently
    right_px: Array


class RearView(NamedTuple):
    """What n cameras saw of it, (n,) each; NaN where a side was not found."""

    track_id: Array  # int64, -1 for none
    left_px: Array
    right_px: Array
    doubt_px: Array  # standard deviation of the distance between them


def nobody_watched(n: int) -> Watched:
    """n cameras without a body to look for."""
    return Watched(np.full(n, NOBODY, np.int64), *(np.full(n, np.nan) for _ in range(4)))


def nothing_seen(n: int) -> RearView:
    """n cameras that saw nothing."""
    return RearView(np.full(n, NOBODY, np.int64), *(np.full(n, np.nan) for _ in range(3)))


def look(frames: Array, watched: Watched, projection: Projection) -> RearView:
    """The sides of the bodies watched in frames (n, rows, columns) uint8; the last row is the image's."""
    seen = nothing_seen(len(watched.track_id))
    look_fleet(frames, watched, projection, seen)
    return seen


def watch(
    track_id: Array,
    now_m: tuple[Array, Array],
    next_m: tuple[Array, Array],
    view: RearView,
    turn_rad: Array,
    projection: Projection,
) -> Watched:
    """What to look for next: the bodies `track_id` (n,), -1 for none.

    now_m, next_m : (x, y) of each body, (n,), in this frame and the next; turn_rad (n,) : yaw between them.
    """
    shift = projection.focal * np.tan(turn_rad)
    sides = moved_sides(track_id, now_m[0], next_m[0], view, shift, projection.forward, projection.center_x)
    return Watched(track_id, *next_m, *sides)
