"""Rendered frames of cars on a road with markings, frame after frame."""

import numpy as np

from camera_synth.camera import Camera, projection
from camera_synth.condition import looks, preset
from camera_synth.pose import Pose
from camera_synth.render import new_frames, render
from sumo_net.randomness import stream_key
from tests.roads import no_objects, road_ahead

CAMERA = Camera()


class Drive:
    """n vehicles on a road given by (curvature, rate) at the start, frame after frame."""

    def __init__(self, n, condition="clear", seed=0, speed=25.0, **road):
        self.n, self.speed, self.road = n, speed, road
        self.looks = looks(preset(condition, world_seed=seed + 1), n)
        self.keys = np.array([stream_key(seed, f"car{i}", "camera") for i in range(n)], np.uint64)
        self.start = np.random.default_rng(seed).uniform(0.0, 3000.0, n)
        self.frames, self.count = new_frames(n), 0

    def frame(self, offset, heading):
        """Frames with the cars there; returns the truth (offset, heading, curvature at the preview)."""
        gone = self.speed * 0.1 * self.count
        k0 = self.road.get("curvature", 0.0) + gone * self.road.get("rate", 0.0)
        ahead = road_ahead(
            k0, self.road.get("rate", 0.0), offset, heading, self.start + gone, lanes_left=2, lanes_right=2
        )
        pose = Pose(self.start + gone, np.zeros(self.n), np.zeros(self.n))
        counter = np.full(self.n, self.count, np.int64)
        render(
            self.frames,
            projection(CAMERA),
            ahead,
            no_objects(self.n),
            pose,
            self.looks,
            self.keys,
            counter,
            90,
        )
        self.count += 1
        return k0 + self.road.get("rate", 0.0) * CAMERA.preview_m
