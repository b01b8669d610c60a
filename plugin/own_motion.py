"""The vehicle's own sensors in the chain: their readings, and those that the estimators use."""

from typing import NamedTuple

import numpy as np

from ego_synth import sensors
from ego_synth.sensors import Readings, SensorState
from plugin.configuration import Configuration
from plugin.motion import observer
from plugin.motion.estimate import MotionEstimate, OwnReadings
from sumo_net.arrays import Array
from sumo_net.ego import EgoTruth


class OwnMotion(NamedTuple):
    """The own motion of n vehicles as known without camera and radar, (n,) each."""

    readings: Readings
    observed: OwnReadings  # for the observer: NaN where it uses the camera alone


class OwnSensors:
    """The sensors with their settings; `step` once per 0.1 s."""

    def __init__(self, configuration: Configuration, seed: int) -> None:
        self._sensors, self._seed = configuration.ego_sensors, seed

    def init(self, vehicle_ids: list[str]) -> SensorState:
        """State of vehicles before their first reading."""
        return sensors.init(self._sensors, self._seed, vehicle_ids)

    def step(self, state: SensorState, truth: EgoTruth) -> tuple[SensorState, OwnMotion]:
        """Readings of n vehicles."""
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
        """The gyroscope's yaw rate (n,) minus its offset as last estimated; NaN without a gyroscope."""
        return own.observed.yaw_rate_rps - observer.gyroscope_offset(state)

    def for_radar(self, own: OwnMotion, state: observer.State, motion: MotionEstimate) -> Readings:
        """The readings with the best available yaw rate; unchanged where the sensors have no error."""
        if not self._sensors.used:
            return own.readings
        return own.readings._replace(yaw_rate_rps=observer.yaw_rate(state, motion, own.readings.yaw_rate_rps))
