"""`sumo-adas evaluate`: accuracy over many seeds, clear and complex, against the stated targets.

The seeds are not those used for tuning (below 100). Each run has its own process.
"""

import concurrent.futures
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from rich.console import Console
from rich.progress import Progress

from analysis import evaluation_text
from analysis.fork_server import ForkServer
from analysis.metrics import (
    CATEGORIES,
    TABLES,
    before_crossing,
    paired_gain,
    prediction_errors,
    summary,
    tlc_error,
)
from analysis.simulate import settings_of, simulate
from analysis.statistics import quantile, quantile_ratio_interval
from plugin.record import read_table
from plugin.truth import HORIZONS_S

CONDITIONS = ("clear", "complex")
BASELINES = ("constant_velocity", "constant_radius")


class Target(NamedTuple):
    """A bound on one figure of the summary, by condition."""

    figure: str
    least: bool  # True: the figure must be at least the bound
    clear: float
    complex: float


TARGETS = (
    Target("recognition_rate", True, 0.999, 0.98),
    Target("lateral_offset_rmse_m", False, 0.03, 0.06),
    Target("heading_rmse_rad", False, 0.002, 0.004),
    Target("curvature_rmse_1pm", False, 2e-4, 4e-4),
    Target("tlc_error_median_s", False, 0.1, 0.1),
    Target("tlc_error_p95_ratio", False, 1.25, 1.25),
    Target("warned_rate", True, 0.995, 0.995),
    Target("false_per_100km", False, 1.0, 1.0),
    Target("class_accuracy", True, 0.995, 0.995),
    Target("ttc_error_p95_s", False, 0.3, 0.3),
    Target("conflicts_due_warned_rate", True, 1.0, 1.0),
    Target("fcw_danger_false_per_100km", False, 1.0, 1.0),
    *(
        Target(f"prediction_{horizon:.1f}s_{part}_ratio", False, 1.25, 1.25)
        for horizon in HORIZONS_S
        for part in ("median", "p95")
    ),
    Target("gain_over_baselines_m", True, 0.0, 0.0),
)


def evaluate(
    out: Path, scenario: str, seeds: Iterable[int], duration_s: float, fraction: float, workers: int
) -> pd.DataFrame:
    """Run `scenario` for every seed and condition, print measured and target values, write `evaluation.csv`.

    Returns that table: condition, figure, measured, wanted (the bound, if there is one), at_least (whether it
    is a lower one), reached. Raises SettingsError before any run.
    """
    seeds = list(seeds)
    settings_of(scenario, duration_s=duration_s, fraction=fraction)
    jobs = [(condition, seed) for condition in CONDITIONS for seed in seeds]
    terminal = Console(stderr=True)
    with (
        Progress(transient=True, console=terminal, disable=not terminal.is_terminal) as progress,
        ForkServer() as server,
        concurrent.futures.ThreadPoolExecutor(workers) as pool,
    ):
        task = progress.add_task("runs", total=len(jobs))
        futures = [
            pool.submit(
                server.result,
                _one,
                scenario,
                out / condition / str(seed),
                seed,
                duration_s,
                fraction,
                condition,
            )
            for condition, seed in jobs
        ]
        for future in concurrent.futures.as_completed(futures):
            future.result()
            progress.advance(task)
    results, errors = [], {}
    for condition in CONDITIONS:
        tables = {name: _gather(out / condition, seeds, name) for name in TABLES}
        errors[condition] = by_category(tables)
        errors[condition].to_csv(out / f"predictions_{condition}.csv", index=False)
        results.append(judge(tables, errors[condition], condition))
    table = pd.concat(results, ignore_index=True)
    table.to_csv(out / "evaluation.csv", index=False)
    console = Console(highlight=False)
    evaluation_text.show(table, errors, console)
    console.print(f"All figures, by run and together: {out}", markup=False, soft_wrap=True)
    return table


def judge(tables: dict[str, pd.DataFrame], errors: pd.DataFrame, condition: str) -> pd.DataFrame:
    """Every figure of the summary of these runs, with its bound if there is one; `errors` by category."""
    figures = summary(**tables) | tlc_ratio(tables["steps"]) | prediction_ratios(tables["predictions"])
    figures["gain_over_baselines_m"] = min(errors[f"{name}_low_m"].min() for name in BASELINES)
    bounds = {target.figure: target for target in TARGETS}
    rows = []
    for name, measured in figures.items():
        row: dict[str, object] = {"condition": condition, "figure": name, "measured": measured}
        target = bounds.get(name)
        if target is not None:
            wanted = target.clear if condition == "clear" else target.complex
            row |= {"wanted": wanted, "at_least": target.least}
            row["reached"] = measured >= wanted if target.least else measured <= wanted
        rows.append(row)
    return pd.DataFrame(rows)


def tlc_ratio(steps: pd.DataFrame) -> dict[str, float]:
    """95th percentile of |TLC error| over that of the true state, with a 95 % bootstrap interval.

    Resampled by vehicle: the steps of an approach are correlated, and so are the approaches of a driver.
    """
    near = before_crossing(steps)
    error, floor = tlc_error(near, "tlc_s"), tlc_error(near, "tlc_true_state_s")
    vehicle = near.groupby(["run_id", "vehicle_id"], observed=True).ngroup().to_numpy()
    low, high = quantile_ratio_interval(error, floor, vehicle, 0.95)
    return {
        "tlc_error_p95_ratio": quantile(error, 0.95) / quantile(floor, 0.95),
        "tlc_error_p95_ratio_low": low,
        "tlc_error_p95_ratio_high": high,
    }


def prediction_ratios(predictions: pd.DataFrame) -> dict[str, float]:
    """Prediction error over that of the same predictor fed with the true state, by horizon."""
    ratios = {}
    for row in prediction_errors(predictions).to_dict("records"):
        for part in ("median", "p95"):
            ratio = row[f"predicted_{part}_m"] / row[f"true_state_{part}_m"]
            ratios[f"prediction_{row['horizon_s']:.1f}s_{part}_ratio"] = ratio
    return ratios


def by_category(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Prediction errors by category and horizon, and paired gains over both baselines with intervals."""
    steps, predictions = tables["steps"], tables["predictions"]
    errors = prediction_errors(predictions, steps)
    for baseline in BASELINES:
        gain = paired_gain(predictions, steps, baseline).rename(
            columns={name: f"{baseline}_{name}" for name in ("gain_m", "low_m", "high_m")}
        )
        errors = errors.merge(gain, on=["category", "horizon_s"], how="left")
    order = {name: k for k, name in enumerate(("all", *CATEGORIES))}
    return errors.sort_values(
        ["category", "horizon_s"], key=lambda column: column.map(order).fillna(column), ignore_index=True
    )


def _one(scenario: str, out: Path, seed: int, duration_s: float, fraction: float, condition: str) -> None:
    simulate(
        scenario,
        out,
        seed=seed,
        duration_s=duration_s,
        fraction=fraction,
        condition=condition,
        formats=("parquet",),
        compare_paper=True,
        threads=1,
        quiet=True,
    )


def _gather(directory: Path, seeds: Iterable[int], name: str) -> pd.DataFrame:
    return pd.concat([read_table(directory / str(seed), name) for seed in seeds], ignore_index=True)
