"""What `sumo-adas evaluate` prints: each figure beside its target, and the path's errors by category."""

import math
from typing import Any, NamedTuple

import pandas as pd
from rich.console import Console
from rich.table import Table

from analysis.metrics import CATEGORIES
from analysis.summary import lateral_cm, number
from plugin.truth import HORIZONS_S


class Line(NamedTuple):
    """How a figure of the evaluation is printed."""

    figure: str
    words: str
    unit: str = ""
    scale: float = 1.0  # from the figure to the unit
    decimals: int = 0


LINES = (
    Line("distance_km", "driven", "km"),
    Line("recognition_rate", "lane recognised", "%", 100.0, 2),
    Line("paper_recognition_rate", "  by the published search", "%", 100.0, 1),
    Line("lateral_offset_rmse_m", "lateral offset, RMS error", "cm", 100.0, 1),
    Line("heading_rmse_rad", "heading", "mrad", 1e3, 2),
    Line("curvature_rmse_1pm", "curvature at the preview point", "1e-4/m", 1e4, 2),
    Line("departures_due", "departures due"),
    Line("warned_rate", "  warned before the crossing", "%", 100.0, 1),
    Line("median_lead_time_s", "  lead time, median", "s", 1.0, 2),
    Line("false_per_100km", "false warnings per 100 km", "", 1.0, 2),
    Line("nuisance_per_100km", "nuisance warnings per 100 km", "", 1.0, 1),
    Line("tlc_error_median_s", "TLC error below 1 s, median", "s", 1.0, 3),
    Line("tlc_error_p95_ratio", "  95th percentile / true state's", "", 1.0, 2),
    *(
        Line(f"prediction_{horizon:.1f}s_{part}_ratio", words, "", 1.0, 2)
        for horizon in HORIZONS_S
        for part, words in (
            ("median", f"path after {horizon:.1f} s, median / true state's"),
            ("p95", "  95th percentile / true state's"),
        )
    ),
    Line("gain_over_baselines_m", "gain over baselines, lowest bound", "cm", 100.0, 3),
    Line("conflicts_due", "rear-end conflicts due"),
    Line("conflicts_due_warned_rate", "  warned before", "%", 100.0, 1),
    Line("fcw_danger_false_per_100km", "false danger warnings per 100 km", "", 1.0, 2),
    Line("fcw_danger_nuisance", "nuisance danger warnings"),
    Line("ttc_steps", "steps with a TTC below 3 s"),
    Line("ttc_error_median_s", "  TTC error, median", "s", 1.0, 2),
    Line("ttc_error_p95_s", "  95th percentile", "s", 1.0, 2),
    Line("class_accuracy", "motion class right", "%", 100.0, 2),
)


def figures(results: pd.DataFrame) -> Table:
    """The main rows of `evaluation.csv`: one line per figure, measured and wanted in each condition."""
    conditions = list(results["condition"].unique())
    rows = {(row["condition"], row["figure"]): row for row in results.to_dict("records")}
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("figure", no_wrap=True)
    for condition in conditions:
        table.add_column(condition, justify="right", no_wrap=True)
        table.add_column("wanted", no_wrap=True)
    for line in LINES:
        cells = [cell for condition in conditions for cell in _cells(rows[condition, line.figure], line)]
        table.add_row(f"{line.words}{', ' * bool(line.unit)}{line.unit}", *cells)
    return table


def _cells(row: dict[Any, Any], line: Line) -> tuple[str, str]:
    measured = number(line.scale * row["measured"], line.decimals)
    if pd.isna(row["wanted"]):
        return measured, ""
    bound = f"{'≥' if row['at_least'] else '≤'} {line.scale * row['wanted']:g}"
    reached = row["reached"] or math.isnan(row["measured"])  # nothing to judge: no conflict was due
    return measured, bound if reached else f"[bold]{bound} NOT[/bold]"


def path_errors(errors: pd.DataFrame, condition: str) -> Table:
    """Median and 95th percentile of the predicted path's lateral error and of its references, at 2 s."""
    horizon_s = HORIZONS_S[-1]
    references = {
        "predicted": "predicted",
        "true_state": "true state",
        "constant_velocity": "const. velocity",
        "constant_radius": "const. radius",
    }
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(f"path {horizon_s:g} s, {condition}, cm", no_wrap=True)
    for words in references.values():
        table.add_column(words, justify="right", no_wrap=True)
    chosen = errors[errors["horizon_s"] == horizon_s].set_index("category")
    for name in ("all", *CATEGORIES):
        if name in chosen.index:
            row = chosen.loc[name].to_dict()
            table.add_row(name.replace("_", " "), *(lateral_cm(row, label) for label in references))
    return table


def verdict(results: pd.DataFrame) -> str:
    """How many targets are reached, and which are not."""
    judged = results[results["wanted"].notna() & results["measured"].notna()]
    missed = judged[~judged["reached"].astype(bool)]
    words = f"{len(judged) - len(missed)} of {len(judged)} targets reached"
    if missed.empty:
        return words
    return words + "; not: " + ", ".join(missed["figure"] + " (" + missed["condition"] + ")")


def show(results: pd.DataFrame, errors: dict[str, pd.DataFrame], console: Console) -> None:
    """Print everything; `errors`: those of `by_category`, by condition."""
    console.print(figures(results))
    for condition, one in errors.items():
        console.print()
        console.print(path_errors(one, condition))
    console.print("median / 95th percentile")
    console.print()
    console.print(verdict(results), soft_wrap=True)
