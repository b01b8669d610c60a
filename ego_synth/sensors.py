"""The vehicles' own sensors: yaw rate, steering-wheel angle, wheel speed, acceleration.

Every car with stability control has them on its bus. A reading is the truth times a scale, plus an offset,
plus noise, rounded to the sensor's resolution. Scale and offset are drawn per vehicle; the offsets of yaw
rate and steering drift. Noise and resolution are those of a recorded production car where it has the signal,
see docs/ego_sensors.md. Lags shorter than the step of 0.1 s are neglected.
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field

from ego_synth import sensor_kernels
from ego_synth.sensor_kernels import SensorNumbers
from sumo_net.arrays import Array
from sumo_net.randomness import generator, stream_key
from sumo_net.settings import kernel_view, settings
from sumo_net.step import STEP_S

_STREAM = "ego sensors"


@settings
class EgoSensors:
    """Errors of the vehicle's own sensors. Noise and differences between vehicles are standard deviations."""

    used: bool = Field(
        True,
        description="false: observer and lane tracker use the camera alone, and speed, acceleration and the "
        "radar's yaw rate have no error",
    )
    yaw_rate_noise_rps: float = Field(1e-3, ge=0, le=0.1, description="gyroscope: noise of a reading")
    yaw_rate_resolution_rps: float = Field(1.2e-3, ge=0, le=0.1, description="gyroscope: resolution; 0: none")
    yaw_rate_offset_rps: float = Field(
        2e-3, ge=0, le=0.1, description="gyroscope: offset, which differs between vehicles"
    )
    yaw_rate_walk_rps: float = Field(
        2e-5, ge=0, le=0.01, description="gyroscope: random walk of the offset, per √s"
    )

    steering_ratio: float = Field(
        16.0, gt=1, le=40, description="steering-wheel angle over front-wheel angle"
    )
    steering_noise_rad: float = Field(
        math.radians(0.03), ge=0, le=0.5, description="steering wheel: noise of a reading"
    )
    steering_resolution_rad: float = Field(
        math.radians(0.1), ge=0, le=0.5, description="steering wheel: resolution; 0: none"
    )
    steering_offset_rad: float = Field(
        math.radians(1.0),
        ge=0,
        le=0.5,
        description="steering wheel: offset (wheel alignment), which differs between vehicles",
    )
    steering_walk_rad: float = Field(
        math.radians(0.01), ge=0, le=0.1, description="steering wheel: random walk of the offset, per √s"
    )
    steering_scale: float = Field(0.01, ge=0, le=0.2, description="steering: relative error of the ratio")

    speed_noise_mps: float = Field(0.02, ge=0, le=2, description="wheel speed: noise of a reading")
    speed_resolution_mps: float = Field(0.01, ge=0, le=1, description="wheel speed: resolution; 0: none")
    speed_scale: float = Field(
        0.001,
        ge=0,
        le=0.1,
        description="wheel speed: relative error (tyre radius), which differs between vehicles",
    )

    acceleration_noise_mps2: float = Field(
        0.05, ge=0, le=5, description="longitudinal acceleration: noise of a reading"
    )
    acceleration_resolution_mps2: float = Field(
        0.02, ge=0, le=1, description="longitudinal acceleration: resolution; 0: none"
    )
    acceleration_offset_mps2: float = Field(
        0.1,
        ge=0,
        le=2,
        description="longitudinal acceleration: offset (slope of the road, mounting), which differs between "
        "vehicles",
    )


class SensorState(NamedTuple):
    """State of n vehicles' sensors, (n,) each."""

    key: Array  # uint64
    reading: Array  # int64, number of the next reading
    yaw_rate_offset_rps: Array
    steering_offset_rad: Array
    steering_scale: Array  # 1: no error
    speed_scale: Array  # 1: no error
    acceleration_offset_mps2: Array


class Readings(NamedTuple):
    """One reading of n vehicles' sensors, (n,) each; left positive."""

    speed_mps: Array
    acceleration_mps2: Array
    yaw_rate_rps: Array
    steering_wheel_rad: Array


@functools.cache
def _numbers(sensors: EgoSensors) -> SensorNumbers:
    per_step = math.sqrt(STEP_S)
    return kernel_view(
        SensorNumbers,
        sensors,
        yaw_rate_walk_rps=sensors.yaw_rate_walk_rps * per_step,
        steering_walk_rad=sensors.steering_walk_rad * per_step,
    )


def init(sensors: EgoSensors, seed: int, vehicle_ids: Sequence[str]) -> SensorState:
    """The sensors of n vehicles before their first reading, each drawn from (seed, vehicle id) alone."""
    c = sensors
    spread = np.array(
        [
            c.yaw_rate_offset_rps,
            c.steering_offset_rad,
            c.steering_scale,
            c.speed_scale,
            c.acceleration_offset_mps2,
        ]
    )
    n = len(vehicle_ids)
    drawn = np.empty((n, len(spread)))
    for i, name in enumerate(vehicle_ids):
        drawn[i] = spread * generator(seed, name, _STREAM).standard_normal(len(spread))
    yaw_rate, steering, ratio, speed, acceleration = np.ascontiguousarray(drawn.T)
    keys = np.array([stream_key(seed, name, f"{_STREAM} noise") for name in vehicle_ids], np.uint64)
    return SensorState(
        keys, np.zeros(n, np.int64), yaw_rate, steering, 1.0 + ratio, 1.0 + speed, acceleration
    )


def read(
    sensors: EgoSensors,
    state: SensorState,
    speed_mps: Array,
    acceleration_mps2: Array,
    yaw_rate_rps: Array,
    steer_rad: Array,
) -> tuple[SensorState, Readings]:
    """One reading of n vehicles from the true speed, acceleration, yaw rate, front-wheel angle, (n,) each.

    Without `used`, speed, acceleration and yaw rate are the truth and the steering wheel is NaN.
    """
    n = len(speed_mps)
    if not sensors.used:
        return state, Readings(speed_mps, acceleration_mps2, yaw_rate_rps, np.full(n, np.nan))
    new = SensorState(*(part.copy() for part in state))
    out = Readings(*(np.empty(n) for _ in Readings._fields))
    sensor_kernels.read(_numbers(sensors), new, speed_mps, acceleration_mps2, yaw_rate_rps, steer_rad, out)
    return new, out
