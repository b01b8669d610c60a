"""Kernel of the vehicle's own sensors over the fleet."""

import math
from typing import NamedTuple

from sumo_net.compile import kernel
from sumo_net.randomness import normal

_DRAWS = 8  # counters of the noise reserved for a reading


class SensorNumbers(NamedTuple):
    """The parameters of EgoSensors, as kernels take them."""

    yaw_rate_noise_rps: float
    yaw_rate_resolution_rps: float
    yaw_rate_walk_rps: float  # per step
    steering_ratio: float
    steering_noise_rad: float
    steering_resolution_rad: float
    steering_walk_rad: float  # per step
    speed_noise_mps: float
    speed_resolution_mps: float
    acceleration_noise_mps2: float
    acceleration_resolution_mps2: float


@kernel
def rounded(value, resolution):  # type: ignore[no-untyped-def]
    """`value` to the nearest step of the sensor."""
    if resolution <= 0.0:
        return value
    return resolution * math.floor(value / resolution + 0.5)


@kernel
def read(c, state, speed, acceleration, yaw_rate, steer, out):  # type: ignore[no-untyped-def]
    """One reading of n vehicles into `out` (Readings); `state` (SensorState) is the caller's own."""
    for i in range(speed.size):
        key, at = state.key[i], _DRAWS * state.reading[i]
        state.reading[i] += 1
        state.yaw_rate_offset_rps[i] += c.yaw_rate_walk_rps * normal(key, at)
        state.steering_offset_rad[i] += c.steering_walk_rad * normal(key, at + 1)
        turning = yaw_rate[i] + state.yaw_rate_offset_rps[i] + c.yaw_rate_noise_rps * normal(key, at + 2)
        out.yaw_rate_rps[i] = rounded(turning, c.yaw_rate_resolution_rps)
        wheel = c.steering_ratio * state.steering_scale[i] * steer[i] + state.steering_offset_rad[i]
        wheel += c.steering_noise_rad * normal(key, at + 3)
        out.steering_wheel_rad[i] = rounded(wheel, c.steering_resolution_rad)
        rolling = 0.0
        if speed[i] > 0.0:  # a standstill is read without error
            rolling = max(0.0, state.speed_scale[i] * speed[i] + c.speed_noise_mps * normal(key, at + 4))
        out.speed_mps[i] = rounded(rolling, c.speed_resolution_mps)
        pushed = (
            acceleration[i]
            + state.acceleration_offset_mps2[i]
            + c.acceleration_noise_mps2 * normal(key, at + 5)
        )
        out.acceleration_mps2[i] = rounded(pushed, c.acceleration_resolution_mps2)
