"""Short ways to frames for the tests of the camera synthesiser."""

from typing import Any

import numpy as np

from camera_synth.camera import Camera, projection
from camera_synth.condition import Condition, looks, preset
from camera_synth.pose import Pose
from camera_synth.render import new_frames, render
from sumo_net.randomness import stream_key
from sumo_net.road import RoadAhead
from sumo_net.surroundings import Objects
from tests.roads import no_objects

ASPHALT, PAINT, VERGE = 100.0, 220.0, 60.0
PLAIN = {
    "asphalt_grey": ASPHALT,
    "paint_grey": PAINT,
    "verge_grey": VERGE,
    "visibility_m": 1e9,
    "texture": 0.0,
    "wheel_tracks": 0.0,
    "drift": 0.0,
    "vignetting": 0.0,
    "noise_grey": 0.0,
}


def plain(**changes: Any) -> Condition:
    """Flat greys without noise, so that grey tells coverage."""
    return preset("clear", **{**PLAIN, **changes})


def keys_of(count: int) -> np.ndarray:
    return np.array([stream_key(3, f"car{i}", "camera") for i in range(count)], np.uint64)


def shoot(
    road: RoadAhead,
    condition: Condition,
    camera: Camera | None = None,
    objects: Objects | None = None,
    pose: tuple[Any, Any, Any] = (0.0, 0.0, 0.0),
    counter: int = 0,
    first_row: int = 0,
) -> np.ndarray:
    """Frames (n, 240, 320) of n roads."""
    n = len(road.forward_m)
    frames = new_frames(n)
    where = Pose(*(np.ascontiguousarray(np.broadcast_to(np.asarray(value, float), n)) for value in pose))
    render(
        frames,
        projection(camera or Camera()),
        road,
        objects if objects is not None else no_objects(n),
        where,
        looks(condition, n),
        keys_of(n),
        np.full(n, counter, np.int64),
        first_row,
    )
    return frames


def row_of(frame: np.ndarray, y: int) -> np.ndarray:
    """Image row y, counted up from the bottom, as float."""
    return frame[239 - y].astype(float)
