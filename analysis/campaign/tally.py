"""Counts of a run that can be added over runs: integers only, so that the order does not matter.

Lengths and squares are counted in small integer units, distributions in fixed bins.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from analysis.metrics import ERRORS, before_crossing, distance_km, offset_error, tlc_error, warning_counts
from analysis.rear_end import before_collision, conflict_counts, settled, ttc_error
from plugin.truth import HORIZONS_S

Tally = dict[str, int]  # "name" or "distribution|bin" -> count; JSON as it is

PER_DECADE = 20  # bins of errors: 12 % wide
LEAST = 1e-4  # smaller errors share one bin
TIME_BIN_S = 0.1
_SQUARE = 10**12  # squares are counted in units of 1 / this


def tally(tables: Mapping[str, pd.DataFrame]) -> Tally:
    """All counts of one run's tables (those of `analysis.metrics.TABLES`)."""
    steps, warnings, departures = tables["steps"], tables["warnings"], tables["departures"]
    km = distance_km(steps)
    counts = warning_counts(warnings, departures, km) | conflict_counts(tables["conflicts"], warnings, km)
    out: Tally = {
        "runs": 1,
        "distance_mm": round(km * 1e6),
        "vehicle_steps": len(steps),
        "vehicles": int(steps["vehicle_id"].nunique()),
    }
    out |= {name: int(counts[name]) for name in COUNTS}
    out |= _lane(steps)
    near, close = before_crossing(steps), before_collision(steps)
    out |= _errors("tlc_error", tlc_error(near, "tlc_s"))
    out |= _errors("tlc_true_state_error", tlc_error(near, "tlc_true_state_s"))
    out |= _errors("ttc_error", ttc_error(close))
    out |= _times("true_tlc", steps["true_tlc_s"])
    out |= _times("true_ttc", steps.loc[steps["true_ttc_s"] < 10.0, "true_ttc_s"])
    out |= _times("ldw_lead_time", departures["lead_time_s"])
    out |= _times("conflict_lead_time", tables["conflicts"]["lead_time_s"])
    out |= _times("conflict_min_ttc", tables["conflicts"]["min_ttc_s"])
    for horizon in HORIZONS_S:
        part = tables["predictions"][np.isclose(tables["predictions"]["horizon_s"], horizon)]
        for label, column in ERRORS.items():
            out |= _errors(f"{label}_{horizon:.1f}s", part[column].abs())
    out |= _classes(tables["tracks"])
    return out


_OUTCOMES = ("", "_true", "_nuisance", "_false")
COUNTS = (
    "departures",
    "departures_due",
    "departures_warned",
    "departures_missed",
    "warnings",
    "warnings_true",
    "warnings_nuisance",
    "warnings_false",
    "conflicts",
    "conflicts_critical",
    "conflicts_due",
    "conflicts_due_warned",
    *(f"fcw_{level}{end}" for level in ("reminder", "danger") for end in _OUTCOMES),
)


def add(total: Tally, one: Mapping[str, int]) -> Tally:
    """Add the counts of `one` to `total`, which is returned."""
    for name, count in one.items():
        total[name] = total.get(name, 0) + int(count)
    return total


def quantile(total: Mapping[str, int], name: str, q: float) -> float:
    """Upper edge of the bin that contains the quantile of a distribution; NaN without counts."""
    bins = sorted(
        (float(key.split("|")[1]), count) for key, count in total.items() if key.startswith(f"{name}|")
    )
    count = sum(c for _, c in bins)
    below = 0
    for edge, c in bins:
        below += c
        if below >= q * count:
            return edge
    return float("nan")


def distribution(total: Mapping[str, int], name: str) -> list[tuple[float, int]]:
    """(upper edge, count) of the bins that are not empty, ascending."""
    found = [(float(key.split("|")[1]), count) for key, count in total.items() if key.startswith(f"{name}|")]
    return sorted(found)


def _lane(steps: pd.DataFrame) -> Tally:
    marked = steps[steps["on_marked_road"].fillna(False)]
    locked = marked[marked["lane_locked"].fillna(False)]
    out = {
        "marked_steps": len(marked),
        "judged": int(marked["recognised"].notna().sum()),
        "recognised": int(marked["recognised"].fillna(False).sum()),
        "paper_judged": int(marked["paper_recognised"].notna().sum()),
        "paper_recognised": int(marked["paper_recognised"].fillna(False).sum()),
        "locked": len(locked),
    }
    for name, error in (
        ("lateral_offset_m", offset_error(locked)),
        ("heading_error_rad", locked["heading_error_rad"] - locked["true_heading_error_rad"]),
        ("curvature_1pm", locked["curvature_1pm"] - locked["true_curvature_1pm"]),
    ):
        out[f"square_{name}"] = round(float(np.square(error).sum()) * _SQUARE)
    return out


def root_mean_square(total: Mapping[str, int], name: str) -> float:
    """RMS error of lateral_offset_m, heading_error_rad or curvature_1pm."""
    count = total.get("locked", 0)
    return float(np.sqrt(total[f"square_{name}"] / _SQUARE / count)) if count else float("nan")


def _errors(name: str, values: "pd.Series[Any]") -> Tally:
    """Counts in logarithmic bins, named by their upper edge; NaN is left out."""
    known = values.dropna().to_numpy(np.float64)
    with np.errstate(divide="ignore"):
        place = np.ceil(np.log10(np.maximum(known, LEAST) / LEAST) * PER_DECADE - 1e-9)
    bins, counts = np.unique(place, return_counts=True)
    edges = [LEAST * 10.0 ** (b / PER_DECADE) if np.isfinite(b) else np.inf for b in bins.tolist()]
    return {f"{name}|{edge:.6g}": int(count) for edge, count in zip(edges, counts, strict=True)}


def _times(name: str, values: "pd.Series[Any]") -> Tally:
    known = values.dropna().to_numpy(np.float64)
    place = np.ceil(np.clip(known, -10.0, 60.0) / TIME_BIN_S - 1e-9).astype(np.int64)
    bins, counts = np.unique(place, return_counts=True)
    return {f"{name}|{b * TIME_BIN_S:.1f}": int(c) for b, c in zip(bins.tolist(), counts, strict=True)}


def _classes(tracks: pd.DataFrame) -> Tally:
    judged = settled(tracks)
    pair = judged["true_motion_state"] + " as " + judged["motion_state"]
    return {f"class {name}": int(count) for name, count in pair.value_counts().items()}
