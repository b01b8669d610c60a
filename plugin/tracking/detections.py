"""Inputs and outputs of tracking: detections, ego motion, estimates."""

from typing import NamedTuple

import numpy as np

from sumo_net.arrays import Array


class Detections(NamedTuple):
    """D radar detections of the whole fleet in one step, (D,) each."""

    owner: Array  # int64, row of the sensor vehicle in the fleet
    range_m: Array  # from the radar
    range_rate_mps: Array  # positive: opening
    azimuth_rad: Array  # left of the vehicle's axis
    label: Array  # int64, the target where association is given, else -1


class EgoMotion(NamedTuple):
    """Motion of the n sensor vehicles as they measure it, (n,) each."""

    speed_mps: Array
    acceleration_mps2: Array
    yaw_rate_rps: Array
    lateral_speed_mps: Array  # v_y of the centre of gravity; 0 if unknown


class SensorMotion(NamedTuple):
    """Motion of the radar itself over ground, in the vehicle's axes, (n,) each."""

    vx: Array
    vy: Array
    ax: Array
    ay: Array
    yaw_rate: Array


class Estimate(NamedTuple):
    """T tracks, (T,) each, in the axes of the vehicle now; velocity and acceleration over ground."""

    range_m: Array  # from the radar, as are rate and azimuth
    range_rate_mps: Array
    azimuth_rad: Array
    x_m: Array  # from the centre of gravity
    y_m: Array
    vx_mps: Array
    vy_mps: Array
    ax_mps2: Array
    ay_mps2: Array
    probability_cv: Array  # NaN if the filter has no such mode


def at_rest(n: int) -> EgoMotion:
    """n vehicles that stand still."""
    return EgoMotion(*(np.zeros(n) for _ in EgoMotion._fields))


def sensor_motion(ego: EgoMotion, mount_forward_m: float) -> SensorMotion:
    """The motion of a radar `mount_forward_m` ahead of the centre of gravity; v̇_y and γ̇ are left out."""
    vy = ego.lateral_speed_mps + ego.yaw_rate_rps * mount_forward_m
    return SensorMotion(
        ego.speed_mps,
        vy,
        ego.acceleration_mps2 - ego.yaw_rate_rps * vy,
        ego.yaw_rate_rps * ego.speed_mps,
        ego.yaw_rate_rps,
    )
