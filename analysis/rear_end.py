"""Figures of radar and rear-end warning from tables: conflicts, warnings, track errors."""

import numpy as np
import pandas as pd

from analysis.statistics import mean, per_100_km, poisson_interval, quantile

NEAR_TTC_S = 3.0  # errors of the time to collision are counted below this
VISIBLE_S = 1.0  # a warning is due if the leader has been in path and in view for this long
SETTLED_CYCLES = 3  # a class is due after this many


def rear_end_figures(
    steps: pd.DataFrame, tracks: pd.DataFrame, conflicts: pd.DataFrame, warnings: pd.DataFrame, km: float
) -> dict[str, float]:
    """All figures of the radar chain by name, of one or more runs."""
    return {**conflict_counts(conflicts, warnings, km), **ttc_errors(steps), **track_accuracy(tracks)}


def conflict_counts(conflicts: pd.DataFrame, warnings: pd.DataFrame, km: float) -> dict[str, float]:
    """Conflicts and how many were warned in time; warnings of both levels by outcome.

    A warning is due for a conflict whose true time to collision falls under 2 s, if the leader has been in
    path and in view for a second by then.
    """
    known = conflicts[conflicts["warned"].notna()]  # empty in tables of an older schema
    due = known[known["critical_s"].notna() & (known["visible_s"] >= VISIBLE_S)]
    figures: dict[str, float] = {
        "conflicts": len(conflicts),
        "conflicts_critical": int(conflicts["critical_s"].notna().sum()),
        "conflicts_due": len(due),
        "conflicts_due_warned": int(due["warned"].sum()),
        "conflicts_due_warned_rate": mean(due["warned"]),
        "conflict_median_lead_time_s": float(due["lead_time_s"].median()),
        "conflicts_per_100km": per_100_km(len(conflicts), km),
    }
    fcw = warnings[warnings["kind"] == "fcw"]
    for level in ("reminder", "danger"):
        outcome = fcw.loc[fcw["level"] == level, "outcome"]
        figures[f"fcw_{level}"] = len(outcome)
        for name in ("true", "nuisance", "false"):
            figures[f"fcw_{level}_{name}"] = int((outcome == name).sum())
        false = int(figures[f"fcw_{level}_false"])
        low, high = poisson_interval(false)
        figures[f"fcw_{level}_false_per_100km"] = per_100_km(false, km)
        figures[f"fcw_{level}_false_per_100km_low"] = per_100_km(low, km)
        figures[f"fcw_{level}_false_per_100km_high"] = per_100_km(high, km)
    return figures


def ttc_errors(steps: pd.DataFrame) -> dict[str, float]:
    """|error| of the time to collision where the true one is under 3 s and the leader is in view.

    Bodies that overlap have collided: only before that there is a time to collision. The same goes for
    a leader that another vehicle overlaps: sensors see one body there, which moves as either.
    """
    seen = in_sight(steps)
    near = before_collision(steps)
    error, every = ttc_error(near), ttc_error(seen)
    by_track = ttc_error(near, "fcw_track_ttc_s") if "fcw_track_ttc_s" in near else error + np.inf
    return {
        "ttc_steps": len(near),
        "ttc_steps_overlapping": len(seen) - len(near),
        "ttc_error_median_s": quantile(error, 0.5),
        "ttc_error_p95_s": quantile(error, 0.95),
        "ttc_error_with_overlap_p95_s": quantile(every, 0.95),
        "ttc_track_error_median_s": quantile(by_track, 0.5),  # from the radar tracks alone
        "ttc_track_error_p95_s": quantile(by_track, 0.95),
        "ttc_no_target_rate": mean(near["fcw_track_id"].isna()),
        "ttc_unforeseen_rate": mean(np.isinf(error)),  # those, and gaps that seem to open
        "ttc_track_unforeseen_rate": mean(np.isinf(by_track)),
    }


def in_sight(steps: pd.DataFrame) -> pd.DataFrame:
    """The steps at which the true time to collision is under NEAR_TTC_S and the leader is in view."""
    return steps[(steps["true_ttc_s"] < NEAR_TTC_S) & steps["true_leader_visible"].fillna(False)]


def before_collision(steps: pd.DataFrame) -> pd.DataFrame:
    """Those of `in_sight` at which no body overlaps the leader's, neither the own one nor another."""
    seen = in_sight(steps)
    apart = seen["true_gap_m"] > 0.0
    if "true_leader_overlapped" in seen:  # not in tables of an older version
        apart &= ~seen["true_leader_overlapped"].fillna(False).astype(bool)
    return seen[apart]


def ttc_error(near: pd.DataFrame, column: str = "fcw_ttc_s") -> pd.Series:
    """|TTC error|; infinite without a target, and with a gap that seems to open."""
    return (near[column].fillna(np.inf) - near["true_ttc_s"]).abs()


def settled(tracks: pd.DataFrame) -> pd.DataFrame:
    """The rows of tracks that have a true class, after the cycles in which theirs is due."""
    cycle = tracks.groupby(["run_id", "vehicle_id", "track_id"], observed=True, sort=False).cumcount()
    return tracks[(cycle >= SETTLED_CYCLES) & tracks["true_motion_state"].notna()]


def track_accuracy(tracks: pd.DataFrame) -> dict[str, float]:
    """Share of right classes after the third cycle, all and by true class, and errors of the estimates."""
    judged = settled(tracks)
    right = judged["motion_state"] == judged["true_motion_state"]
    figures: dict[str, float] = {"track_steps": len(tracks), "class_accuracy": mean(right)}
    for name, part in right.groupby(judged["true_motion_state"], observed=True):
        figures[f"class_accuracy_{name}"] = mean(part)
    for name in ("range_m", "range_rate_mps", "azimuth_rad", "vx_mps"):
        error = tracks[name] - tracks[f"true_{name}"]
        figures[f"track_{name.rsplit('_', 1)[0]}_rmse_{name.rsplit('_', 1)[1]}"] = float(
            np.sqrt(np.square(error).mean())
        )
    return figures
