"""The 400-run IMM experiment: this project's batched filters against filterpy's objects.

    python benchmarks/radar_filters.py [--runs 400] [--filterpy-runs 20]

filterpy runs on fewer Monte-Carlo runs (its cost is proportional to them) and is scaled up; both do the same
filters, models, noise and scans, and their results are compared.
"""

import argparse
import time

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter

from analysis.published.imm import FILTERS, ImmExperiment, run, simulate
from plugin.tracking.models import POLAR_H, polar_models


def filterpy_run(experiment: ImmExperiment, kinds: tuple[str, ...], z: np.ndarray) -> np.ndarray:
    """The same as `run` with filterpy objects, one Monte-Carlo run after the other; (steps, runs, 6)."""
    F, Q = polar_models(kinds, experiment.motion).transition(np.array([experiment.step_s]))
    R, P = experiment.noise.covariance, np.zeros((6, 6))
    P[np.ix_([0, 1, 3], [0, 1, 3])] = R
    P[2, 2] = experiment.start_acceleration_mps2**2
    P[4, 4] = P[5, 5] = experiment.start_angular_rps**2
    markov = np.array([[experiment.stay, 1 - experiment.stay], [1 - experiment.stay, experiment.stay]])
    out = np.empty((*z.shape[:2], 6))
    for i in range(z.shape[1]):
        filters = []
        for j in range(len(kinds)):
            one = KalmanFilter(6, 3)
            one.x, one.P, one.F, one.Q, one.H, one.R = (
                z[0, i] @ POLAR_H,
                P.copy(),
                F[0, j],
                Q[0, j],
                POLAR_H,
                R,
            )
            filters.append(one)
        whole = IMMEstimator(filters, [0.5, 0.5], markov) if len(kinds) == 2 else filters[0]
        out[0, i] = whole.x
        for k in range(1, len(z)):
            whole.predict()
            whole.update(z[k, i])
            out[k, i] = whole.x
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--filterpy-runs", type=int, default=20)
    options = parser.parse_args()
    experiment = ImmExperiment(runs=options.runs)
    _, _, z = simulate(experiment)
    ours: dict[str, np.ndarray] = {}
    for kinds in FILTERS.values():
        run(experiment, kinds, z[:3])  # compile
    begin = time.perf_counter()
    for name, kinds in FILTERS.items():
        ours[name], _ = run(experiment, kinds, z)
    batched = time.perf_counter() - begin
    few = z[:, : options.filterpy_runs]
    begin = time.perf_counter()
    theirs = {name: filterpy_run(experiment, kinds, few) for name, kinds in FILTERS.items()}
    objects = (time.perf_counter() - begin) * options.runs / few.shape[1]
    updates = options.runs * (len(z) - 1)
    print(
        f"{options.runs} runs, CV + CA + IMM: batched {batched:.3f} s ({1e6 * batched / updates:.2f} us/scan)"
    )
    print(
        f"filterpy objects {objects:.1f} s (from {few.shape[1]} runs): {objects / batched:.0f} times slower"
    )
    worst = max(np.abs(ours[name][:, : few.shape[1]] - theirs[name]).max() for name in FILTERS)
    print(f"largest difference of any state: {worst:.1e}")


if __name__ == "__main__":
    main()
