"""Figures from tables: lane accuracy, prediction errors and baselines, warnings and departures."""

import functools

import numpy as np
import pandas as pd

from analysis.rear_end import rear_end_figures
from analysis.statistics import mean, per_100_km, poisson_interval, quantile, ratio_interval
from plugin.record import arrow_schema, to_pandas
from plugin.schema import TABLES as COLUMNS
from plugin.tracking.classification import NAMES as CLASSES
from plugin.truth import HORIZONS_S, STRADDLING_M
from sumo_net.step import STEP_S

TABLES = ("steps", "predictions", "warnings", "departures", "tracks", "conflicts")  # of `summary`
CURVE_1PM = 2e-4  # a road less curved than this counts as straight
CATEGORIES = ("straight", "curve", "lane_change", "distraction")
ERRORS = {
    "predicted": "lateral_error_m",
    "true_state": "true_state_lateral_error_m",
    "constant_velocity": "constant_velocity_lateral_error_m",
    "constant_radius": "constant_radius_lateral_error_m",
}
NEAR_TLC_S = 1.0  # up to here the errors of the TLC are judged
SIGNALLED = "lane_change_signalled"


def distance_km(steps: pd.DataFrame) -> float:
    """Kilometres driven by equipped vehicles."""
    return float(steps["speed_mps"].sum()) * STEP_S / 1000.0


def category(steps: pd.DataFrame) -> pd.Series:
    """One of CATEGORIES for every step, by the driver's true action and the road's true curvature."""
    cause = steps["true_cause"]
    curved = steps[["true_curvature_1pm", "true_curvature_here_1pm"]].abs().max(axis=1) > CURVE_1PM
    values = np.select(
        [cause.str.startswith("lane_change"), cause.isin(["distraction", "microsleep"]), curved],
        ["lane_change", "distraction", "curve"],
        "straight",
    )
    return pd.Series(pd.Categorical(values, CATEGORIES), index=steps.index)


def lane_accuracy(steps: pd.DataFrame) -> dict[str, float]:
    """Recognition rates and root mean square errors of the lane and motion estimates, on marked road."""
    marked = steps[steps["on_marked_road"].fillna(False)]
    judged = marked["recognised"].notna()
    locked = marked[marked["lane_locked"].fillna(False)]
    offset = offset_error(locked)
    result = {
        "recognition_rate": mean(marked.loc[judged, "recognised"]),
        "paper_recognition_rate": mean(marked["paper_recognised"].dropna()),
        "locked_rate": mean(marked["lane_locked"].fillna(False)),
        "other_lane_rate": mean(offset.abs() >= 1.0),
        "lateral_offset_rmse_m": _root_mean_square(offset),
    }
    for name, estimate, truth in (
        ("heading_rmse_rad", "heading_error_rad", "true_heading_error_rad"),
        ("curvature_rmse_1pm", "curvature_1pm", "true_curvature_1pm"),
        ("lateral_speed_rmse_mps", "lateral_speed_mps", "true_lateral_speed_mps"),
        ("yaw_rate_rmse_rps", "yaw_rate_rps", "true_yaw_rate_rps"),
        ("steer_rmse_rad", "steer_rad", "true_steer_rad"),
    ):
        result[name] = _root_mean_square(locked[estimate] - locked[truth])
    return result


def offset_error(locked: pd.DataFrame) -> pd.Series:
    """Estimate minus truth; for a vehicle that straddles a border, with respect to the same lane.

    Estimate and truth may then refer to different lanes: truth switches when the centre of gravity crosses.
    Elsewhere an offset in another lane counts as an error of its full size.
    """
    error = locked["lateral_offset_m"] - locked["true_lateral_offset_m"]
    width = locked["lane_width_m"]
    straddles = locked["true_lateral_offset_m"].abs() > 0.5 * width - STRADDLING_M
    return error.where(~(straddles & (error.abs() > 0.5 * width)), error - np.sign(error) * width)


def prediction_errors(predictions: pd.DataFrame, steps: pd.DataFrame | None = None) -> pd.DataFrame:
    """Median and 95th percentile of |lateral error| by horizon for the prediction, the floor, the baselines.

    With `steps` also by category; the rows are (category, horizon), category "all" first.
    """
    keyed = predictions
    if steps is not None:
        key = ["run_id", "vehicle_id", "time_s"]
        keyed = predictions.merge(steps[key].assign(category=category(steps)), on=key, how="left")
    rows = []
    for name in ["all"] + (list(CATEGORIES) if steps is not None else []):
        chosen = keyed if name == "all" else keyed[keyed["category"] == name]
        for horizon in HORIZONS_S:
            part = chosen[np.isclose(chosen["horizon_s"], horizon)]
            row: dict[str, object] = {"category": name, "horizon_s": horizon, "count": len(part)}
            for label, column in ERRORS.items():
                row[f"{label}_median_m"] = float(part[column].abs().median())
                row[f"{label}_p95_m"] = float(part[column].abs().quantile(0.95))
            rows.append(row)
    return pd.DataFrame(rows)


def paired_gain(predictions: pd.DataFrame, steps: pd.DataFrame, baseline: str) -> pd.DataFrame:
    """Mean of |baseline error| − |prediction error|, by category and horizon, with an interval.

    Paired by step; 95 % bootstrap interval over (run, vehicle), since steps of one vehicle are correlated.
    """
    key = ["run_id", "vehicle_id", "time_s"]
    keyed = predictions.merge(steps[key].assign(category=category(steps)), on=key, how="left")
    keyed["gain"] = keyed[ERRORS[baseline]].abs() - keyed["lateral_error_m"].abs()
    rows = []
    for (name, horizon), part in keyed.groupby(["category", "horizon_s"], observed=True):
        clusters = part.groupby(["run_id", "vehicle_id"])["gain"].agg(["sum", "count"])
        gain_m = clusters["sum"].sum() / clusters["count"].sum()
        low, high = ratio_interval(clusters["sum"].to_numpy(), clusters["count"].to_numpy())
        rows.append({"category": name, "horizon_s": horizon, "gain_m": gain_m, "low_m": low, "high_m": high})
    return pd.DataFrame(rows)


def before_crossing(steps: pd.DataFrame) -> pd.DataFrame:
    """The steps at which the true TLC is in (0, NEAR_TLC_S]."""
    truth = steps["true_tlc_s"]
    return steps[(truth > 0.0) & (truth <= NEAR_TLC_S) & steps["on_marked_road"].fillna(False)]


def tlc_error(near: pd.DataFrame, column: str) -> pd.Series:
    """|TLC error|; infinite where no crossing was predicted within the horizon."""
    return (near[column].fillna(np.inf) - near["true_tlc_s"]).abs()


def tlc_errors(steps: pd.DataFrame) -> dict[str, float]:
    """|TLC error| where the true TLC is in (0, NEAR_TLC_S]: of the estimate, the floor and both baselines."""
    near = before_crossing(steps)
    result: dict[str, float] = {"tlc_steps": len(near)}
    for label, column in (
        ("tlc", "tlc_s"),
        ("tlc_true_state", "tlc_true_state_s"),
        ("tlc_constant_velocity", "tlc_constant_velocity_s"),
        ("tlc_constant_radius", "tlc_constant_radius_s"),
    ):
        error = tlc_error(near, column)
        result[f"{label}_error_median_s"] = quantile(error, 0.5)
        result[f"{label}_error_p95_s"] = quantile(error, 0.95)
        result[f"{label}_unforeseen_rate"] = mean(near[column].isna())
    return result


def unsignalled(departures: pd.DataFrame) -> pd.DataFrame:
    """The departures without a turn signal, of which drivers are to be warned."""
    return departures[departures["cause"] != SIGNALLED]


def warning_counts(warnings: pd.DataFrame, departures: pd.DataFrame, km: float) -> dict[str, float]:
    """Departures warned and missed, warnings by outcome, per 100 km with exact Poisson limits."""
    meant = unsignalled(departures)
    due = meant[meant["warned"].notna()]
    warned = due["warned"].astype(bool)
    outcome = warnings.loc[warnings["kind"] == "ldw", "outcome"]
    false = int((outcome == "false").sum())
    low, high = poisson_interval(false)
    return {
        "departures": len(meant),
        "departures_due": len(due),
        "departures_warned": int(warned.sum()),
        "departures_missed": int((~warned).sum()),
        "warned_rate": mean(warned),
        "in_zone_rate": mean(meant["in_zone"].dropna()),
        "median_lead_time_s": float(due.loc[warned, "lead_time_s"].median()),
        "departures_per_100km": per_100_km(len(meant), km),
        "warnings": len(outcome),
        "warnings_true": int((outcome == "true").sum()),
        "warnings_nuisance": int((outcome == "nuisance").sum()),
        "warnings_false": false,
        "nuisance_per_100km": per_100_km(int((outcome == "nuisance").sum()), km),
        "false_per_100km": per_100_km(false, km),
        "false_per_100km_low": per_100_km(low, km),
        "false_per_100km_high": per_100_km(high, km),
    }


def summary(
    steps: pd.DataFrame,
    predictions: pd.DataFrame,
    warnings: pd.DataFrame,
    departures: pd.DataFrame,
    tracks: pd.DataFrame | None = None,
    conflicts: pd.DataFrame | None = None,
) -> dict[str, float]:
    """All figures by name of a run, or of several runs whose tables are concatenated.

    Those of the radar only if `tracks` and `conflicts` are given.
    """
    km = distance_km(steps)
    result: dict[str, float] = {
        "vehicles": steps.groupby(["run_id", "vehicle_id"], observed=True).ngroups,
        "vehicle_steps": len(steps),
        "distance_km": km,
        **warning_counts(warnings, departures, km),
        **lane_accuracy(steps),
        **tlc_errors(steps),
    }
    for row in prediction_errors(predictions).to_dict("records"):
        horizon = f"{row['horizon_s']:.1f}s"
        for label in ERRORS:
            result[f"{label}_error_{horizon}_median_m"] = row[f"{label}_median_m"]
            result[f"{label}_error_{horizon}_p95_m"] = row[f"{label}_p95_m"]
    if tracks is not None and conflicts is not None:
        result |= rear_end_figures(steps, tracks, conflicts, warnings, km)
    return result


@functools.cache
def figure_names() -> list[str]:
    """Names of all figures of `summary`; those of a true motion class are missing where it does not occur."""
    empty = {name: to_pandas(arrow_schema(COLUMNS[name]).empty_table()) for name in TABLES}
    return [*summary(**empty), *(f"class_accuracy_{name}" for name in CLASSES)]


def _root_mean_square(values: pd.Series) -> float:
    return float(np.sqrt(np.square(values).mean()))  # NaN if all values are
