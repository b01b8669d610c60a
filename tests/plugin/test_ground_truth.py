"""What the estimates are compared with: the points of the paths at the horizons of the table."""

import numpy as np
import pytest
from test_prediction import motion

from plugin.ground_truth import Judge
from plugin.motion.prediction import PredictionSettings, predict, predictor
from plugin.truth import HORIZONS_S, PREDICTORS
from sumo_net.ego import EgoTruth
from sumo_net.road import AHEAD_M
from sumo_net.vehicle import Vehicle

INTEGERS = {"handle": np.int64, "path": np.int32, "lanes_left": np.int32, "on_marked_road": np.bool_}
INTEGERS |= dict.fromkeys(("border_kind_right", "border_kind_left", "signal", "cause"), np.int8)


@pytest.mark.parametrize("step_s", [0.05, 0.1, 0.25])
@pytest.mark.parametrize("horizon_s", [1.0, 3.0])
def test_points_are_at_the_horizons_and_unknown_beyond_the_path(step_s: float, horizon_s: float) -> None:
    chosen = predictor(Vehicle(), PredictionSettings(step_s=step_s, horizon_s=horizon_s))
    truth = EgoTruth._make(np.zeros(1, INTEGERS.get(name, np.float64)) for name in EgoTruth._fields)
    straight, speed_mps = motion(), np.array([20.0])
    path = predict(straight, speed_mps, chosen)
    points = (
        Judge(Vehicle(), 33.5, chosen)
        .reference(truth, np.zeros((1, len(AHEAD_M))), straight, speed_mps, path, np.array([0.75]))
        .points
    )
    want = np.where(np.array(HORIZONS_S) <= horizon_s, 20.0 * np.array(HORIZONS_S), np.nan)
    for name in ("predicted", "constant_velocity"):
        np.testing.assert_allclose(points[PREDICTORS.index(name), 0, :, 0], want, rtol=1e-6)
