"""Front-wheel angle from the camera alone (Zhang et al. 2011, section 2).

The road's heading relative to the vehicle at the preview point changes by ė_L = v K_L − γ. With the road's
curvature subtracted, it gives the yaw rate and, by geometry, the steer of a car without slip (eq. 10); f
corrects it to the steer that the car with slip needs for the same radius (eq. 13).
"""

import numpy as np

from plugin.motion.estimate import Array
from sumo_net.vehicle import Vehicle, steer_correction


def kinematic_steer(
    vehicle: Vehicle,
    curvature_1pm: Array,
    preview_heading_rad: Array,
    preview_heading_before_rad: Array,
    speed_mps: Array,
    step_s: float = 0.1,
) -> Array:
    """δ_k (n,) in rad of eq. 10; NaN at standstill."""
    moving = np.where(np.asarray(speed_mps) > 0.0, speed_mps, np.nan)
    turned = np.asarray(preview_heading_rad) - np.asarray(preview_heading_before_rad)
    return np.asarray(vehicle.wheelbase_m * (curvature_1pm - turned / (moving * step_s)))


def dynamic_steer(vehicle: Vehicle, kinematic_steer_rad: Array, speed_mps: Array) -> Array:
    """δ_D = f δ_k, (n,) in rad (eq. 13)."""
    return np.asarray(steer_correction(vehicle, speed_mps) * kinematic_steer_rad)
