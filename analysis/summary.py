"""The summary of a run on the terminal."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from analysis.metrics import ERRORS, TABLES, summary
from analysis.rear_end import VISIBLE_S
from plugin.record import read_table
from plugin.truth import HORIZONS_S

_LABELS = {
    "predicted": "predicted path",
    "true_state": "  from the true state",
    "constant_velocity": "  constant velocity",
    "constant_radius": "  constant radius",
}


def print_summary(directory: Path) -> None:
    """Print the figures of the run whose tables lie in `directory`, in lines of at most 80 characters."""
    console = Console(highlight=False)
    figures = summary(**{name: read_table(directory, name) for name in TABLES})
    by_class = ", ".join(read_table(directory, "runs")["equipped_by_class"].dropna())
    if not figures["vehicle_steps"]:
        why = f"equipped: {by_class}, see `equipment`" if by_class else "no vehicle was on the road"
        console.print(f"No equipped vehicle drove ({why}). Tables: {directory}", markup=False, soft_wrap=True)
        return
    console.print(_figures(figures, by_class))
    console.print()
    console.print(_predictions(figures))
    console.print(f"\nTables: {directory}", markup=False, soft_wrap=True)


def _figures(f: dict[str, float], by_class: str) -> Table:
    rows = [
        ("equipped vehicles", f"{f['vehicles']:.0f}, {f['distance_km']:.1f} km"),
        ("  by SUMO class", by_class),
        ("departures", f"{f['departures']:.0f} ({f['departures_per_100km']:.1f} per 100 km)"),
    ]
    if f["departures"]:
        rows += [
            (
                "  warned before",
                f"{f['departures_warned']:.0f} of {f['departures_due']:.0f} due, "
                f"median {number(f['median_lead_time_s'])} s before",
            ),
            ("  missed", f"{f['departures_missed']:.0f}"),
        ]
    rows += [
        ("warnings", _by_outcome(f, "warnings")),
        (
            "  false per 100 km",
            f"{f['false_per_100km']:.2f} (95 % interval {f['false_per_100km_low']:.2f} to "
            f"{f['false_per_100km_high']:.2f})",
        ),
        ("lane recognised", _share(f["recognition_rate"])),
    ]
    if not math.isnan(f["paper_recognition_rate"]):
        rows.append(("  published search", _share(f["paper_recognition_rate"])))
    rows.append(
        (
            "lane error (RMS)",
            f"{number(100.0 * f['lateral_offset_rmse_m'], 1)} cm, {number(1e3 * f['heading_rmse_rad'])} mrad",
        )
    )
    if f["tlc_steps"]:
        rows += [
            ("TLC error below 1 s", _time_error(f, "tlc")),
            ("  from the true state", _time_error(f, "tlc_true_state")),
        ]
    rows += _rear_end(f)
    table = Table(show_header=False, box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for row in rows:
        table.add_row(*row)
    return table


def _rear_end(f: dict[str, float]) -> list[tuple[str, str]]:
    rows = [
        (
            "rear-end conflicts",
            f"{f['conflicts']:.0f}, {f['conflicts_critical']:.0f} with a time to collision under 2 s",
        )
    ]
    if f["conflicts_due"]:
        rows.append(("  warned in time", f"{f['conflicts_due_warned']:.0f} of {f['conflicts_due']:.0f} due"))
    elif f["conflicts_critical"]:
        rows.append(("  warned in time", f"none due: in view for less than {VISIBLE_S:g} s before"))
    rows += [(f"{level} warnings", _by_outcome(f, f"fcw_{level}")) for level in ("reminder", "danger")]
    if f["ttc_steps"]:
        rows.append(("TTC error below 3 s", _time_error(f, "ttc")))
        rows.append(("  by the track alone", _time_error(f, "ttc_track")))
    rows.append(
        ("radar tracks", f"{f['track_steps']:.0f} rows, class right in {_share(f['class_accuracy'], 'them')}")
    )
    return rows


def _by_outcome(f: dict[str, float], name: str) -> str:
    parts = [f"{f[f'{name}_{outcome}']:.0f} {outcome}" for outcome in ("true", "nuisance", "false")]
    return f"{f[name]:.0f}: {', '.join(parts)}"


def _predictions(f: dict[str, float]) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("lateral error in cm")
    for horizon in HORIZONS_S:
        table.add_column(f"{horizon:.1f} s", justify="right")
    for label in ERRORS:
        cells = [lateral_cm(f, f"{label}_error_{h:.1f}s") for h in HORIZONS_S]
        table.add_row(_LABELS[label], *cells)
    table.caption = "median / 95th percentile"
    table.caption_justify = "left"
    return table


def _time_error(f: dict[str, float], name: str) -> str:
    median, p95 = (f[f"{name}_error_{part}_s"] for part in ("median", "p95"))
    words = "median not predicted" if math.isinf(median) else f"median {number(median)} s"
    if math.isinf(p95):
        steps = f[f"{name.split('_')[0]}_steps"]
        return f"{words}, none predicted in {f[f'{name}_unforeseen_rate'] * steps:.0f} of {steps:.0f} steps"
    return f"{words}, 95th percentile {number(p95)} s"


def lateral_cm(figures: Mapping[Any, float], name: str) -> str:
    """Median and 95th percentile in cm, of figures in m."""
    return " / ".join(number(100.0 * figures[f"{name}_{part}_m"], 1) for part in ("median", "p95"))


def number(value: float, decimals: int = 2) -> str:
    """As text; a dash for NaN."""
    return "–" if math.isnan(value) else f"{value:.{decimals}f}"


def _share(value: float, of: str = "frames") -> str:
    return "–" if math.isnan(value) else f"{100.0 * value:.2f} % of {of}"
