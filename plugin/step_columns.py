"""The columns of the table `steps` that are known in the step itself, (n,) each; text as codes."""

from typing import Any

import numpy as np

from plugin.ground_truth import Reference
from plugin.motion.estimate import MotionEstimate
from plugin.truth import PREDICTORS
from plugin.vision import Sight
from plugin.warning.departure import DepartureWarning
from plugin.warning.tlc import Crossing
from sumo_net.arrays import Array
from sumo_net.ego import EgoTruth
from sumo_net.snapshot import Snapshot

Columns = dict[str, Any]

_SIDE_CODES = np.array([-1, 0, 1])  # indexed by side: 0 none, 1 left, -1 (the last) right


def join(*parts: Columns) -> Columns:
    """The columns of the fleet from those of its parts."""
    if len(parts) == 1:
        return parts[0]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def of_time(step: int, time_s: float, handle: Array) -> Columns:
    """Vehicle, step and time."""
    n = len(handle)
    return {"handle": handle, "step": np.full(n, step), "time_s": np.full(n, time_s)}


def of_truth(truth: EgoTruth, snapshot: Snapshot) -> Columns:
    """True position and motion."""
    return {
        "lane_id": snapshot.lane[np.searchsorted(snapshot.handle, truth.handle)],
        "speed_mps": truth.speed_mps,
        "x_m": truth.x_m,
        "y_m": truth.y_m,
        "world_heading_rad": truth.heading_rad,
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
    """Results of the camera chain."""
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
    """The observer's estimates."""
    return {
        "lateral_speed_mps": motion.lateral_speed_mps,
        "yaw_rate_rps": motion.yaw_rate_rps,
        "steer_rad": motion.steer_rad,
    }


def of_warning(crossing: Crossing, warning: DepartureWarning) -> Columns:
    """Time to lane crossing by the vehicle's own prediction, and the warning."""
    return {
        "tlc_s": crossing.tlc_s,
        "tlc_side": _SIDE_CODES[crossing.side],
        "ldw_active": warning.side != 0,
        "ldw_state": warning.code,
        "warning_side": warning.side.astype(np.int64),
    }


def of_reference(reference: Reference) -> Columns:
    """What the estimates are compared with: paths, times to lane crossing, and the truth in the lane."""
    columns: Columns = dict(zip(PREDICTORS, reference.points, strict=True))
    columns |= {f"tlc_{name}_s": one for name, one in zip(PREDICTORS[1:], reference.tlc_s, strict=True)}
    return columns | {
        "true_curvature_1pm": reference.curvature_1pm,
        "drift_mps": reference.drift_mps,
        "margin_left_m": reference.margin_left_m,
        "margin_right_m": reference.margin_right_m,
    }
