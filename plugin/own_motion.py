"""The vehicle's own sensors in the chain: what they read, and what of it the estimators are given."""

from typing import Any, NamedTuple

import numpy as np

from ego_synth import sensors
from ego_synth.sensors import Readings, SensorState
from plugin.configuration import Configuration
from plugin.motion import observer
from plugin.motion.estimate import MotionEstimate, OwnReadings
from sumo_net.ego import EgoTruth

Array = np.ndarray[Any, Any]


class OwnMotion(NamedTuple):
    """What n vehicles know of their own motion without camera and radar, (n,) each."""

    readings: Readings
    observed: OwnReadings  # for the observer: NaN where the camera is all that it has


class OwnSensors:
    """The sensors with their settings; `step` once per 0.1 s."""

    def __init__(self, configuration: Configuration, seed: int) -> None:
        self._sensors, self._seed = configuration.ego_sensors, seed

    def init(self, vehicle_ids: list[str]) -> SensorState:
        """State of vehicles before their first reading."""
        return sensors.init(self._sensors, self._seed, vehicle_ids)

    def step(self, state: SensorState, truth: EgoTruth) -> tuple[SensorState, OwnMotion]:
        """Read, for n vehicles."""
        after, readings = sensors.read(
            self._sensors,
            state,
            truth.speed_mps,
            truth.acceleration_mps2,
            truth.yaw_rate_rps,
            truth.steer_rad,
        )
        steer = readings.steering_wheel_rad / self._sensors.steering_ratio
        yaw_rate = readings.yaw_rate_rps if self._sensors.used else np.full(len(steer), np.nan)
        return after, OwnMotion(readings, OwnReadings(yaw_rate, steer))

    def turning(self, own: OwnMotion, state: observer.State) -> Array:
        """The gyroscope's yaw rate (n,) less what was known of its offset in the step before; NaN without."""
        return own.observed.yaw_rate_rps - observer.gyroscope_offset(state)

    def for_radar(self, own: OwnMotion, state: observer.State, motion: MotionEstimate) -> Readings:
        """The readings with the best yaw rate there is; as they are where the sensors make no error."""
        if not self._sensors.used:
            return own.readings
        return own.readings._replace(yaw_rate_rps=observer.yaw_rate(state, motion, own.readings.yaw_rate_rps))
