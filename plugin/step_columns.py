"""The columns of the table `steps` that a step knows, (n,) each, from what its parts give; text as codes."""

from typing import Any

import numpy as np

from plugin.motion.estimate import MotionEstimate, Trajectory
from plugin.truth import HORIZONS_S, STEP_S
from plugin.vision import Sight
from plugin.warning.departure import DepartureWarning
from plugin.warning.tlc import Crossing
from sumo_net.ego import EgoTruth
from sumo_net.snapshot import Snapshot

Array = np.ndarray[Any, Any]
Columns = dict[str, Any]

_HORIZON = np.rint(np.array(HORIZONS_S) / STEP_S).astype(np.int64) - 1  # into a Trajectory's points
_SIDE_CODES = np.array([-1, 0, 1])  # of no side, the left (+1) and, counted from the end, the right (-1)


def join(*parts: Columns) -> Columns:
    """Those of one part of the fleet after those of the other."""
    if len(parts) == 1:
        return parts[0]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def of_time(step: int, time_s: float, handle: Array) -> Columns:
    """Whose rows these are, and of when."""
    n = len(handle)
    return {"handle": handle, "step": np.full(n, step), "time_s": np.full(n, time_s)}


def of_truth(truth: EgoTruth, snapshot: Snapshot) -> Columns:
    """Place and motion as they truly are."""
    drift = truth.speed_mps * np.sin(truth.lane_heading_rad)
    drift += truth.lateral_speed_mps * np.cos(truth.lane_heading_rad)
    return {
        "lane_id": snapshot.lane[np.searchsorted(snapshot.handle, truth.handle)],
        "speed_mps": truth.speed_mps,
        "x_m": truth.x_m,
        "y_m": truth.y_m,
        "world_heading_rad": truth.heading_rad,
        "drift_mps": drift,
        "cause": truth.cause.astype(np.int64),
        "signal": truth.signal,
        "true_lateral_offset_m": truth.lane_offset_m,
        "true_lane_width_m": truth.lane_width_m,
        "true_heading_error_rad": truth.lane_heading_rad,
        "true_curvature_here_1pm": truth.curvature_1pm,
        "true_lateral_speed_mps": truth.lateral_speed_mps,
        "true_yaw_rate_rps": truth.yaw_rate_rps,
        "true_steer_rad": truth.steer_rad,
        "on_marked_road": truth.on_marked_road,
    }


def of_sight(sight: Sight) -> Columns:
    """What the camera chain found."""
    lane, borders = sight.lane, sight.borders
    return {
        "lane_locked": lane.locked,
        "left_a": borders.left[:, 0],
        "left_b": borders.left[:, 1],
        "left_c": borders.left[:, 2],
        "right_a": borders.right[:, 0],
        "right_b": borders.right[:, 1],
        "right_c": borders.right[:, 2],
        "lane_score": lane.score,
        "lateral_offset_m": lane.lateral_offset_m,
        "heading_error_rad": lane.heading_error_rad,
        "curvature_1pm": lane.curvature_1pm,
        "lane_width_m": lane.lane_width_m,
        "recognised": sight.recognised,
        "paper_recognised": sight.beside_recognised,
    }


def of_motion(motion: MotionEstimate) -> Columns:
    """What the observer made of it."""
    return {
        "lateral_speed_mps": motion.lateral_speed_mps,
        "yaw_rate_rps": motion.yaw_rate_rps,
        "steer_rad": motion.steer_rad,
    }


def of_warning(crossings: dict[str, Crossing], warning: DepartureWarning) -> Columns:
    """Times to lane crossing, by prediction, baselines and from the true state, and the warning."""
    return {
        "tlc_s": crossings["predicted"].tlc_s,
        "tlc_side": _SIDE_CODES[crossings["predicted"].side],
        "tlc_constant_velocity_s": crossings["constant_velocity"].tlc_s,
        "tlc_constant_radius_s": crossings["constant_radius"].tlc_s,
        "tlc_true_state_s": crossings["true_state"].tlc_s,
        "ldw_active": warning.side != 0,
        "ldw_state": warning.code,
        "warning_side": warning.side.astype(np.int64),
    }


def of_paths(paths: dict[str, Trajectory]) -> Columns:
    """(n, 4, 3) of each path by name: forward and left in m, heading in rad at HORIZONS_S."""
    return {name: _points(path) for name, path in paths.items()}


def _points(path: Trajectory) -> Array:
    points = np.empty((len(path.forward_m), len(_HORIZON), 3))
    for k, part in enumerate((path.forward_m, path.left_m, path.heading_rad)):
        part.take(_HORIZON, axis=1, out=points[..., k], mode="clip")
    return points
