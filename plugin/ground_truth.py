"""What the estimates of a step are compared with: the truth in the chain's terms, and baselines."""

from typing import NamedTuple

import numpy as np

from plugin.ground_truth_kernels import compare
from plugin.motion.estimate import MotionEstimate, Trajectory
from plugin.motion.prediction_kernels import Predictor
from plugin.truth import HORIZONS_S, PREDICTORS
from sumo_net.arrays import Array
from sumo_net.ego import EgoTruth
from sumo_net.road import AHEAD_M
from sumo_net.vehicle import Vehicle


class Reference(NamedTuple):
    """What the estimates of n vehicles are compared with."""

    points: Array  # (4, n, 4, 3) forward, left, heading at HORIZONS_S of the paths PREDICTORS
    tlc_s: Array  # (3, n) by the paths other than the vehicle's own
    curvature_1pm: Array  # (n,) of the path at the preview point; NaN where it ends before
    drift_mps: Array  # (n,) lateral speed in the lane, left positive
    margin_left_m: Array  # (n,) from the front wheel's outer edge to the border, positive inside;
    margin_right_m: Array  # NaN where no marking is painted


class Judge:
    """Makes the reference of each step."""

    def __init__(self, vehicle: Vehicle, preview_m: float, predictor: Predictor) -> None:
        """preview_m: the camera's D_L, up to which the true change of curvature is taken."""
        self._front_axle_m, self._preview_m, self._predictor = vehicle.front_axle_m, preview_m, predictor
        later = min(max(int(np.searchsorted(AHEAD_M, preview_m)), 1), len(AHEAD_M) - 1)
        before, after = AHEAD_M[later - 1], AHEAD_M[later]
        self._at = later, float((preview_m - before) / (after - before))
        self._horizon = np.rint(np.array(HORIZONS_S) / predictor.step_s).astype(np.int64) - 1

    def reference(
        self,
        truth: EgoTruth,
        curvature_1pm: Array,
        motion: MotionEstimate,
        speed_mps: Array,
        path: Trajectory,
        half_span_m: Array,
    ) -> Reference:
        """For n vehicles whose observer estimates `motion` and whose predicted path is `path`.

        curvature_1pm (n, J) : of the road at AHEAD_M; speed_mps (n,) : as the vehicles measure it.
        """
        n = len(speed_mps)
        tlc = np.empty((len(PREDICTORS) - 1, n))
        out = Reference(
            np.empty((len(PREDICTORS), n, len(HORIZONS_S), 3)),
            tlc,
            *np.empty((len(Reference._fields) - 2, n)),
        )
        compare(
            truth,
            curvature_1pm,
            motion,
            speed_mps,
            path,
            half_span_m,
            self._predictor,
            self._front_axle_m,
            self._preview_m,
            self._at,
            self._horizon,
            out,
        )
        return out
