"""Path, time to lane crossing and warning from a recorded lane and a speed, by the filters of a run."""

from typing import NamedTuple

import numpy as np

from analysis.camera_view import path_in_image
from camera_synth.camera import Camera, projection
from plugin.lane.estimate import LaneEstimate
from plugin.motion import observer
from plugin.motion.observer import ObserverSettings
from plugin.motion.prediction import PredictionSettings, predict, predictor
from plugin.warning import departure
from plugin.warning.departure import DepartureSettings
from plugin.warning.tlc import time_to_lane_crossing
from sumo_net.arrays import Array
from sumo_net.vehicle import Vehicle


class Ahead(NamedTuple):
    """What one frame leads to."""

    path: Array  # (H, 2) column and y in the 320x240 image, of the next 2 s
    tlc_s: float  # to the crossing on that path; NaN: none, or the motion is not known yet
    side: str  # left, right, or '' without a crossing
    state: str  # of the lane-departure warning, one of departure.CODES


class Driven:
    """A default car at constant speed, without a turn signal."""

    def __init__(self, camera: Camera, speed_mps: float, step_s: float) -> None:
        self._projection = projection(camera)
        self._speed = np.array([speed_mps])
        self._vehicle = Vehicle()
        self._schedule = observer.schedule(self._vehicle, camera.preview_m, ObserverSettings(), step_s)
        self._predictor = predictor(self._vehicle, PredictionSettings(horizon_s=2.0))
        self._numbers = departure.numbers(DepartureSettings(), step_s)
        self._begin()

    def _begin(self) -> None:
        self._observed, self._warned = observer.init(1, self._schedule), departure.init(1)

    def step(self, lane: LaneEstimate, fresh: bool) -> Ahead:
        """The next frame; `fresh`: it shows another scene than the one before."""
        if fresh:
            self._begin()
        speed = self._speed
        self._observed, motion = observer.step(self._observed, self._schedule, lane, speed)
        ahead = predict(motion, speed, self._predictor)
        crossing = time_to_lane_crossing(motion, ahead, self._predictor.step_s, self._vehicle)
        unseen_m = lane.left_unseen_m, lane.right_unseen_m
        self._warned, warning = departure.step(
            self._warned, crossing, motion, unseen_m, speed, np.zeros(1, np.int8), self._numbers
        )
        if np.isfinite(ahead.left_m[0]).all():
            path = path_in_image(ahead.forward_m[0], ahead.left_m[0], self._projection)
        else:  # no motion is known yet, as in a still: on with the lane's curvature from the heading of now
            forward = np.arange(1.0, 2.0 * speed[0] + 1.0)
            path = path_in_image(forward, 0.5 * lane.curvature_1pm[0] * forward**2, self._projection)
        tlc = float(crossing.tlc_s[0])
        side = {1: "left", -1: "right"}.get(int(crossing.side[0]), "")
        return Ahead(path, tlc if np.isfinite(tlc) else np.nan, side, departure.CODES[warning.code[0]])
