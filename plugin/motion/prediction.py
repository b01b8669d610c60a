"""Path prediction over the next seconds from (v, v_y, γ, δ, K) (Zhang et al. 2011, 4.2).

`paper` holds the steer. In `refined` the driver follows the road that the camera sees ahead; the steer beyond
that decays, with a return to the lane centre, and fast steering jitter, where the observer separates it, ends
within half a second. The two assumptions that Zhang et al. criticise, constant lateral velocity and constant
turn radius, are here as baselines.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from pydantic import Field

from plugin.motion import prediction_kernels
from plugin.motion.estimate import MotionEstimate, Trajectory
from plugin.motion.prediction_kernels import Predictor
from sumo_net.arrays import Array
from sumo_net.settings import kernel_view, settings
from sumo_net.vehicle import Vehicle, model


@settings
class PredictionSettings:
    """How far to predict, and the assumptions on the driver meanwhile."""

    mode: Literal["paper", "refined"] = Field(
        "refined", description="paper: the steering angle is held; refined: the road is followed"
    )
    horizon_s: float = Field(3.0, gt=0, le=10, description="time that is predicted")
    step_s: float = Field(0.1, gt=0, le=0.5, description="time between two points of the path")
    residual_time_s: float = Field(
        3.0,
        gt=0,
        description="time constant with which steering beyond the road's fades; a huge value: it is held",
    )
    steer_lag_s: float = Field(0.15, gt=0, description="time constant of arm and wheel")
    unrest_rad: float = Field(3.3e-4, ge=0, description="fast steering noise, which does not last")
    unrest_time_s: float = Field(
        0.16, gt=0, description="time constant of that noise, which peaks at 1 / (2π · this) Hz"
    )
    calm_mps2: float = Field(0.12, gt=0, description="lateral acceleration by which a steady driver corrects")
    unrest_doubt: float = Field(
        0.5, ge=0, description="the more is steered, the less of it is taken for noise"
    )
    preview_s: float = Field(
        0.4, ge=0, le=3, description="time ahead from which the driver steers for curvature"
    )
    slow_mps: float = Field(8.0, gt=0, description="below this speed, the residual goes by distance")
    return_gain: float = Field(1.0, ge=0, le=1, description="share of full lane keeping; 0: none")
    return_bandwidth_rps: float = Field(0.7, gt=0, le=2, description="natural frequency of lane keeping")
    return_damping: float = Field(0.8, gt=0, le=2, description="damping ratio of lane keeping")
    curvature_reach_m: float = Field(
        80.0, ge=0, description="distance up to which the change of curvature is used"
    )
    road_jerk_mps3: float = Field(
        1.2,
        gt=0,
        description="refined: change of curvature, as a jerk at the own speed, up to which it is used in "
        "full; from twice that it is ignored (roads are built for 0.3 to 0.9)",
    )

    @property
    def steps(self) -> int:
        """H, the number of points of a path."""
        return max(1, round(self.horizon_s / self.step_s))


def predictor(vehicle: Vehicle, settings: PredictionSettings) -> Predictor:
    """Kernel parameters of the predictor."""
    c = settings
    follows_road = c.mode == "refined"
    return kernel_view(
        Predictor,
        c,
        model=model(vehicle),
        understeer=vehicle.understeer,
        follows_road=follows_road,
        residual_rate=1.0 / c.residual_time_s,
        unrest_rate=1.0 / c.unrest_time_s,
        stiffness=c.return_gain * c.return_bandwidth_rps**2,
        damping=c.return_gain * 2.0 * c.return_damping * c.return_bandwidth_rps,
        road_jerk_mps3=c.road_jerk_mps3 if follows_road else np.inf,
    )


def predict(motion: MotionEstimate, speed_mps: Array, predictor: Predictor) -> Trajectory:
    """Paths of n vehicles by the single-track model, (n, H) each; NaN where the motion is unknown."""
    return _run(prediction_kernels.single_track, motion, speed_mps, predictor)


def constant_velocity(motion: MotionEstimate, speed_mps: Array, predictor: Predictor) -> Trajectory:
    """Baseline: along the road, the offset growing at the present lateral velocity."""
    return _run(prediction_kernels.constant_velocity, motion, speed_mps, predictor)


def constant_radius(motion: MotionEstimate, speed_mps: Array, predictor: Predictor) -> Trajectory:
    """Baseline: on the circle of the present yaw rate and slip, whatever the road does."""
    return _run(prediction_kernels.constant_radius, motion, speed_mps, predictor)


def _run(
    kernel: Callable[..., Any], motion: MotionEstimate, speed_mps: Array, predictor: Predictor
) -> Trajectory:
    n = len(speed_mps)
    out = Trajectory(*(np.empty((n, predictor.steps)) for _ in range(5)))
    kernel(motion, speed_mps, predictor, out)
    return out
