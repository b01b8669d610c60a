"""The Monte-Carlo experiment of the IMM source, section 4: 400 runs, CV and CA filters and the IMM of both.

Truth is deterministic, as in the source: 100 m, −3 m/s, 2°, uniform motion for 10 s; then for 5 s a relative
acceleration of −1.8 m/s² and an angular acceleration of 1 °/s². Scans at 0, 0.1, … 14.9 s; the filters start
from the first one. A phase's RMSE is the mean over its scans of the RMSE over the runs; this reproduces the
reference figures of SPEC section 2 except for random differences.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import Field

from analysis.published import comparison
from plugin.tracking import imm
from plugin.tracking.models import POLAR_H, PUBLISHED_MOTION, PolarMotion, RadarNoise, polar_models
from sumo_net.arrays import Array
from sumo_net.randomness import generator
from sumo_net.settings import settings

FILTERS: dict[str, tuple[str, ...]] = {"cv": ("cv",), "ca": ("ca",), "imm": ("cv", "ca")}
PHASES = {"steady": (3.0, 10.0), "manoeuvre": (10.0, 15.0)}
COMPONENTS = ("range_m", "range_rate_mps", "azimuth_deg")  # degrees as in the source's figures
REFERENCE = {  # SPEC section 2, checked
    ("steady", "cv"): (0.207, 0.078, 0.070),
    ("steady", "ca"): (0.223, 0.238, 0.117),
    ("steady", "imm"): (0.211, 0.103, 0.078),
    ("manoeuvre", "cv"): (1.058, 1.969, 0.475),
    ("manoeuvre", "ca"): (0.218, 0.260, 0.119),
    ("manoeuvre", "imm"): (0.215, 0.292, 0.115),
}


@settings
class ImmExperiment:
    """The source's values; those that it does not give are marked as inferred or ours."""

    runs: int = Field(400, ge=1)
    seed: int = Field(1)
    step_s: float = Field(0.1, gt=0)
    duration_s: float = Field(15.0, gt=0)
    manoeuvre_s: float = Field(10.0, ge=0, description="when it begins")
    start: tuple[float, float, float] = Field((100.0, -3.0, math.radians(2.0)), description="r, ṙ, β")
    acceleration_mps2: float = Field(-1.8)
    angular_acceleration_rps2: float = Field(math.radians(1.0))
    stay: float = Field(0.98, gt=0, lt=1, description="Π's diagonal, inferred: not legible in the source")
    start_acceleration_mps2: float = Field(1.0, gt=0, description="σ of r̈ at the start, ours")
    start_angular_rps: float = Field(math.radians(1.0), gt=0, description="σ of β̇ (and β̈) at the start, ours")
    motion: PolarMotion = PUBLISHED_MOTION
    noise: RadarNoise = Field(default_factory=RadarNoise)


def simulate(experiment: ImmExperiment) -> tuple[Array, Array, Array]:
    """Times (steps,), truth (steps, 3) of (r, ṙ, β), measurements (steps, runs, 3)."""
    steps = round(experiment.duration_s / experiment.step_s)
    t = experiment.step_s * np.arange(steps)
    after = np.clip(t - experiment.manoeuvre_s, 0.0, None)
    r, rate, azimuth = experiment.start
    truth = np.stack(
        [
            r + rate * t + 0.5 * experiment.acceleration_mps2 * after**2,
            rate + experiment.acceleration_mps2 * after,
            azimuth + 0.5 * experiment.angular_acceleration_rps2 * after**2,
        ],
        axis=-1,
    )
    draws = [
        generator(experiment.seed, f"run {i}", "imm").standard_normal((steps, 3))
        for i in range(experiment.runs)
    ]
    sigma = np.sqrt(np.diag(experiment.noise.covariance))
    return t, truth, truth[:, None] + np.stack(draws, axis=1) * sigma


def run(experiment: ImmExperiment, kinds: tuple[str, ...], z: Array) -> tuple[Array, Array]:
    """Estimates (steps, runs, 6) and mode probabilities (steps, runs, r) of the IMM of the models `kinds`."""
    steps, runs, _ = z.shape
    r = len(kinds)
    F, Q = polar_models(kinds, experiment.motion).transition(np.array([experiment.step_s]))
    markov = imm.markov_of(experiment.stay, r)
    R, P = experiment.noise.covariance, np.zeros((6, 6))
    P[np.ix_([0, 1, 3], [0, 1, 3])] = R
    P[2, 2] = experiment.start_acceleration_mps2**2
    P[4, 4] = P[5, 5] = experiment.start_angular_rps**2
    state = imm.init(z[0] @ POLAR_H, np.tile(P, (runs, 1, 1)), np.full(r, 1.0 / r))
    everyone = np.ones(runs, np.bool_)
    x, mu = np.empty((steps, runs, 6)), np.empty((steps, runs, r))
    x[0], mu[0] = imm.combine(state).x, state.mu
    for k in range(1, steps):
        state = imm.predict(state, F, Q, markov[None])
        state, _ = imm.update(state, z[k], everyone, R, out=state)
        x[k], mu[k] = imm.combine(state).x, state.mu
    return x, mu


def curves(experiment: ImmExperiment) -> pd.DataFrame:
    """RMSE over the runs at every scan, and the IMM's mean probability of cv: one row per filter and scan."""
    t, truth, z = simulate(experiment)
    tables = []
    for name, kinds in FILTERS.items():
        x, mu = run(experiment, kinds, z)
        error = (x @ POLAR_H.T - truth[:, None]) * [1.0, 1.0, math.degrees(1.0)]
        rmse = np.sqrt(np.mean(error**2, axis=1))
        table = pd.DataFrame({"filter": name, "time_s": t} | dict(zip(COMPONENTS, rmse.T, strict=True)))
        table["probability_cv"] = mu[..., 0].mean(axis=1) if name == "imm" else np.nan
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def phases(curve: pd.DataFrame) -> pd.DataFrame:
    """One row per phase and filter: RMSE, its ratio to the better of cv and ca, and the SPEC's reference."""
    rows = []
    for phase, (begin, end) in PHASES.items():
        inside = curve[(curve["time_s"] > begin - 1e-6) & (curve["time_s"] < end - 1e-6)]
        means = inside.groupby("filter", sort=False)[list(COMPONENTS)].mean()
        better = means.loc[["cv", "ca"]].min()
        for name in FILTERS:
            row: dict[str, Any] = {"phase": phase, "filter": name}
            for component, reference in zip(COMPONENTS, REFERENCE[phase, name], strict=True):
                row[component] = means.loc[name, component]
                row[f"{component}_ratio"] = means.loc[name, component] / better[component]
                row[f"{component}_reference"] = reference
            rows.append(row)
    return pd.DataFrame(rows)


def compare(phase: pd.DataFrame) -> pd.DataFrame:
    """RMSE and the reference's (the source prints only curves); the IMM over the better of CV and CA."""
    units = {"range_m": "m", "range_rate_mps": "m/s", "azimuth_deg": "°"}
    rows = []
    for one in phase.to_dict("records"):
        for component in COMPONENTS:
            name, unit = (
                f"RMSE {component.rsplit('_', 1)[0].replace('_', ' ')}, {one['filter']}",
                units[component],
            )
            reference = one[f"{component}_reference"]
            rows.append(comparison.row(one["phase"], name, unit, one[component], reference, "checked"))
    for one in phase[phase["filter"] == "imm"].to_dict("records"):
        for component in COMPONENTS:
            name = f"{component.rsplit('_', 1)[0].replace('_', ' ')}, imm over the better model"
            rows.append(comparison.row(one["phase"], name, "", one[f"{component}_ratio"]))
    return comparison.table(rows)


def reproduce(out: Path, experiment: ImmExperiment | None = None) -> pd.DataFrame:
    """Write imm.csv (phases), imm_curves.csv, imm.png and the comparison into `out`; return it."""
    curve = curves(experiment or ImmExperiment())
    phase = phases(curve)
    return comparison.write(out, "imm", {"imm.csv": phase, "imm_curves.csv": curve}, compare(phase))
