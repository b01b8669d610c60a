"""The 400-run IMM experiment: this project's batched filters, and filterpy's and Stone Soup's objects.

    python benchmarks/radar_filters.py [--runs 400] [--object-runs 10] [--out out/bench/filters.json]

The objects do fewer Monte-Carlo runs (their cost is proportional). All use the same filters, models, noise
and scans, and their estimates are compared. A track-step is a prediction and an update. Of Stone Soup only
the Kalman filter is compared. Processor time, medians of three (of 15 for the batched filters).
Packages: `pip install -e '.[bench]'`.
"""

import argparse
import datetime
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter
from side_by_side import cpu_seconds, report
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

from analysis.published.imm import FILTERS, ImmExperiment, run, simulate
from plugin.tracking.models import POLAR_H, polar_models
from sumo_net.memory import keep_freed_memory

REPEATS = 3
OUR_REPEATS = 15  # 15 ms each


def model(experiment: ImmExperiment, kinds: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """F, Q (r, 6, 6), R (3, 3) and the filters' initial P."""
    F, Q = polar_models(kinds, experiment.motion).transition(np.array([experiment.step_s]))
    R, P = experiment.noise.covariance, np.zeros((6, 6))
    P[np.ix_([0, 1, 3], [0, 1, 3])] = R
    P[2, 2] = experiment.start_acceleration_mps2**2
    P[4, 4] = P[5, 5] = experiment.start_angular_rps**2
    return F[0], Q[0], R, P


def filterpy_run(experiment: ImmExperiment, kinds: tuple[str, ...], z: np.ndarray) -> np.ndarray:
    """As `run`, with filterpy objects, one Monte-Carlo run after the other; (steps, runs, 6)."""
    F, Q, R, P = model(experiment, kinds)
    markov = np.array([[experiment.stay, 1 - experiment.stay], [1 - experiment.stay, experiment.stay]])
    out = np.empty((*z.shape[:2], 6))
    for i in range(z.shape[1]):
        filters = []
        for j in range(len(kinds)):
            one = KalmanFilter(6, 3)
            start = z[0, i] @ POLAR_H
            one.x, one.P, one.F, one.Q, one.H, one.R = start, P.copy(), F[j], Q[j], POLAR_H, R
            filters.append(one)
        whole = IMMEstimator(filters, [0.5, 0.5], markov) if len(kinds) == 2 else filters[0]
        out[0, i] = whole.x
        for k in range(1, len(z)):
            whole.predict()
            whole.update(z[k, i])
            out[k, i] = whole.x
    return out


def stonesoup_run(experiment: ImmExperiment, kinds: tuple[str, ...], z: np.ndarray) -> np.ndarray:
    """As `run`, with Stone Soup's Kalman predictor and updater; (steps, runs, 6)."""
    F, Q, R, P = model(experiment, kinds)
    transition = LinearGaussianTimeInvariantTransitionModel(transition_matrix=F[0], covariance_matrix=Q[0])
    measurement = LinearGaussian(ndim_state=6, mapping=(0, 1, 3), noise_covar=R)
    predictor, updater = KalmanPredictor(transition), KalmanUpdater(measurement)
    begin = datetime.datetime(2026, 1, 1)
    times = [begin + datetime.timedelta(seconds=experiment.step_s * k) for k in range(len(z))]
    out = np.empty((*z.shape[:2], 6))
    for i in range(z.shape[1]):
        state = GaussianState((z[0, i] @ POLAR_H)[:, None], P, timestamp=times[0])
        out[0, i] = z[0, i] @ POLAR_H
        for k in range(1, len(z)):
            predicted = predictor.predict(state, timestamp=times[k])
            detection = Detection(z[k, i][:, None], timestamp=times[k], measurement_model=measurement)
            state = updater.update(SingleHypothesis(predicted, detection))
            out[k, i] = np.asarray(state.state_vector, float)[:, 0]
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--object-runs", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("out/bench/filters.json"))
    options = parser.parse_args()
    keep_freed_memory()  # as in every run
    experiment = ImmExperiment(runs=options.runs)
    z = simulate(experiment)[2]
    few = np.ascontiguousarray(z[:, : options.object_runs])
    objects: dict[str, Callable[..., Any]] = {"filterpy": filterpy_run, "Stone Soup": stonesoup_run}
    rows = []
    for name, kinds in FILTERS.items():
        run(experiment, kinds, z[:3])  # compile
        spent, (ours, _) = cpu_seconds(lambda kinds=kinds: run(experiment, kinds, z), OUR_REPEATS)
        base = 1e6 * spent / (z.shape[1] * (len(z) - 1))
        rows.append(
            {"filter": name, "by": "this project, batched", "us a track-step": base, "times ours": 1.0}
            | {"largest difference": 0.0}
        )
        for other, function in objects.items():
            if other == "Stone Soup" and len(kinds) > 1:
                continue
            spent, theirs = cpu_seconds(lambda f=function, kinds=kinds: f(experiment, kinds, few), REPEATS)
            each = 1e6 * spent / (few.shape[1] * (len(few) - 1))
            worst = float(np.abs(ours[:, : few.shape[1]] - theirs).max())
            rows.append(
                {"filter": name, "by": other, "us a track-step": each, "times ours": each / base}
                | {"largest difference": worst}
            )
            assert worst < 1e-6, (name, other, worst)
    note = (
        f"{options.runs} runs batched, {options.object_runs} with objects; differences of any state, SI units"
    )
    report("Radar filters", rows, options.out, ("filterpy", "stonesoup", "numba"), note)


if __name__ == "__main__":
    main()
