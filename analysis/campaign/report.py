"""The report of a campaign: CSV files from the runs' counts, independent of their order."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from analysis.campaign.differences import differences
from analysis.campaign.store import Store
from analysis.campaign.tally import COUNTS, Tally, add, distribution, quantile, root_mean_square
from analysis.metrics import ERRORS
from analysis.statistics import per_100_km, poisson_interval, ratio_interval, wilson_interval
from plugin.tracking.classification import NAMES
from plugin.truth import HORIZONS_S
from sumo_net.settings import SettingsError

RATES = (
    "departures",
    "departures_missed",
    "warnings",
    "warnings_true",
    "warnings_nuisance",
    "warnings_false",
    "conflicts",
    "conflicts_critical",
    "fcw_reminder",
    "fcw_reminder_true",
    "fcw_reminder_nuisance",
    "fcw_reminder_false",
    "fcw_danger",
    "fcw_danger_true",
    "fcw_danger_nuisance",
    "fcw_danger_false",
)
SHARES = {
    "departures_warned": "departures_due",
    "conflicts_due_warned": "conflicts_due",
    "recognised": "judged",
    "paper_recognised": "paper_judged",
}
TIMES = ("true_tlc", "true_ttc", "ldw_lead_time", "conflict_lead_time", "conflict_min_ttc")
_STEPS_PER_H = 36_000


def write_report(out: Any) -> dict[str, pd.DataFrame]:
    """Write the report of the campaign in `out` and return its tables by name. Raises SettingsError."""
    store = Store(out)
    plan = store.read("plan.json")
    if plan is None:
        raise SettingsError(f"{store.address}: holds no campaign")
    cells: dict[int, Tally] = {}
    per_run: list[dict[str, Any]] = []
    for summary in store.summaries():
        counts = summary["counts"]
        add(cells.setdefault(summary["cell"], {}), counts)
        names = ("distance_mm", "vehicle_steps", "vehicles", *COUNTS, "judged", "recognised")
        names += ("paper_judged", "paper_recognised")
        row = {"run": summary["key"], "cell": summary["cell"], "seed": summary["seed"]}
        per_run.append(row | {name: counts.get(name, 0) for name in names})
    runs = pd.DataFrame(per_run)
    whole: Tally = {}
    for total in cells.values():
        add(whole, total)
    groups: list[tuple[dict[str, Any], Tally, pd.DataFrame]] = []
    if len(runs):
        groups.append(({"cell": "all"}, whole, runs))
        for number in sorted(cells):
            values = {name: str(value) for name, value in plan["cells"][number].items()}
            groups.append(({"cell": number} | values, cells[number], runs[runs["cell"] == number]))
    failures = [{"run": key} | cause for key, cause in store.failures().items()]

    def table(rows: Callable[[Tally], Iterable[dict[str, Any]]]) -> pd.DataFrame:
        return pd.DataFrame([label | row for label, total, _ in groups for row in rows(total)])

    tables = {
        "rates": pd.DataFrame([label | row for label, total, part in groups for row in _rates(total, part)]),
        "shares": table(_shares),
        "accuracy": table(_accuracy),
        "predictions": table(_predictions),
        "times": table(_times),
        "classes": table(_classes),
        "benefit": _benefit(plan["cells"], runs) if len(runs) else pd.DataFrame(),
        "differences": _differences(plan["cells"], runs) if len(runs) else pd.DataFrame(),
        "runs": runs,
        "failures": pd.DataFrame(failures, columns=["run", "cause", "attempts"]),
    }
    for name, frame in tables.items():
        text = frame.to_csv(index=False, float_format="%.6g", lineterminator="\n")
        store.write_text(f"{name}.csv", text)
    return tables


def _rates(total: Mapping[str, int], runs: pd.DataFrame) -> Iterable[dict[str, Any]]:
    """Events per 100 km and per hour, with exact Poisson intervals and bootstrap intervals over runs."""
    km, hours = total.get("distance_mm", 0) / 1e6, total.get("vehicle_steps", 0) / _STEPS_PER_H
    for name in RATES:
        count = total.get(name, 0)
        low, high = poisson_interval(count)
        boot_low, boot_high = ratio_interval(runs[name].to_numpy(), runs["distance_mm"].to_numpy() / 1e8)
        yield {
            "figure": name,
            "runs": len(runs),
            "distance_km": km,
            "vehicle_hours": hours,
            "count": count,
            "per_100km": per_100_km(count, km),
            "per_100km_poisson_low": per_100_km(low, km),
            "per_100km_poisson_high": per_100_km(high, km),
            "per_100km_bootstrap_low": boot_low,
            "per_100km_bootstrap_high": boot_high,
            "per_hour": count / hours if hours else math.nan,
        }


def _benefit(cells: list[dict[str, Any]], runs: pd.DataFrame) -> pd.DataFrame:
    """Runs with and without reacting drivers, paired by seed, in cells that differ only in `reaction.on`."""
    rows = []
    numbers = {tuple(sorted((k, str(v)) for k, v in cell.items())): i for i, cell in enumerate(cells)}
    for number, cell in enumerate(cells):
        if cell.get("reaction.on") is not False:
            continue
        partner = numbers.get(tuple(sorted((k, str(v)) for k, v in (cell | {"reaction.on": True}).items())))
        if partner is None:
            continue
        without = runs[runs["cell"] == number].set_index("seed")
        with_ = runs[runs["cell"] == partner].set_index("seed")
        seeds = sorted(set(without.index) & set(with_.index))
        for name in ("departures", "conflicts", "conflicts_critical"):
            before = without.loc[seeds, name].to_numpy(np.int64)
            avoided = before - with_.loc[seeds, name].to_numpy(np.int64)
            low, high = ratio_interval(avoided, np.ones(len(avoided)))
            label = {key: str(value) for key, value in cell.items() if key != "reaction.on"}
            rows.append(
                label
                | {
                    "figure": name,
                    "pairs": len(seeds),
                    "without": int(before.sum()),
                    "avoided": int(avoided.sum()),
                    "avoided_share": avoided.sum() / before.sum() if before.sum() else math.nan,
                    "avoided_per_run": avoided.mean() if len(seeds) else math.nan,
                    "avoided_per_run_low": low,
                    "avoided_per_run_high": high,
                }
            )
    return pd.DataFrame(rows)


def _differences(cells: list[dict[str, Any]], runs: pd.DataFrame) -> pd.DataFrame:
    """Rates per 100 km and shares under each value of the grid, compared with its first value."""
    per_100_km = runs.assign(distance_100km=runs["distance_mm"] / 1e8)
    return differences(cells, per_100_km, dict.fromkeys(RATES, "distance_100km") | SHARES)


def _shares(total: Mapping[str, int]) -> Iterable[dict[str, Any]]:
    """Shares with Wilson's interval."""
    for name, of in SHARES.items():
        count, number = total.get(name, 0), total.get(of, 0)
        row: dict[str, Any] = {"figure": name, "of": of, "count": count, "number": number}
        if number:
            low, high = wilson_interval(count, number)
            row |= {"share": count / number, "low": low, "high": high}
        yield row


def _accuracy(total: Mapping[str, int]) -> Iterable[dict[str, Any]]:
    row: dict[str, Any] = {
        f"rms_{name}": root_mean_square(total, name)
        for name in ("lateral_offset_m", "heading_error_rad", "curvature_1pm")
    }
    for name in ("tlc_error", "tlc_true_state_error", "ttc_error"):
        row |= {f"{name}_median_s": quantile(total, name, 0.5), f"{name}_p95_s": quantile(total, name, 0.95)}
    yield row


def _predictions(total: Mapping[str, int]) -> Iterable[dict[str, Any]]:
    for horizon in HORIZONS_S:
        for label in ERRORS:
            name = f"{label}_{horizon:.1f}s"
            yield {
                "horizon_s": horizon,
                "predictor": label,
                "count": sum(count for _, count in distribution(total, name)),
                "median_m": quantile(total, name, 0.5),
                "p95_m": quantile(total, name, 0.95),
            }


def _times(total: Mapping[str, int]) -> Iterable[dict[str, Any]]:
    for name in TIMES:
        for edge, count in distribution(total, name):
            yield {"figure": name, "up_to_s": edge, "count": count}


def _classes(total: Mapping[str, int]) -> Iterable[dict[str, Any]]:
    for true in NAMES:
        counts = {given: total.get(f"class {true} as {given}", 0) for given in NAMES}
        if any(counts.values()):
            yield {"true": true} | {f"as_{given}": count for given, count in counts.items()}
