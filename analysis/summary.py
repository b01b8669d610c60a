"""The summary of a run on the terminal."""

from pathlib import Path

from rich.console import Console
from rich.table import Table

from analysis.metrics import ERRORS, summary
from plugin.record import read_table
from plugin.truth import HORIZONS_S

_LABELS = {
    "predicted": "predicted path",
    "true_state": "same predictor, true state",
    "constant_velocity": "constant lateral velocity",
    "constant_radius": "constant turn radius",
}


def print_summary(directory: Path, console: Console | None = None) -> None:
    """Print the figures of the run whose tables lie in `directory`."""
    console = console or Console(highlight=False)
    figures = summary(
        read_table(directory, "steps"),
        read_table(directory, "predictions"),
        read_table(directory, "warnings"),
        read_table(directory, "departures"),
    )
    if not figures["vehicle_steps"]:
        console.print(f"No equipped vehicle drove. Tables: {directory}")
        return
    console.print(_figures(figures))
    console.print(_predictions(figures))
    console.print(f"Tables: {directory}", soft_wrap=True)


def _figures(f: dict[str, float]) -> Table:
    table = Table(show_header=False, box=None, pad_edge=False, padding=(0, 2))
    rows = [
        ("equipped vehicles", f"{f['vehicles']:.0f}, {f['distance_km']:.1f} km"),
        (
            "departures",
            f"{f['departures']:.0f} ({f['departures_per_100km']:.1f} per 100 km): "
            f"{f['departures_warned']:.0f} warned before the crossing, {f['departures_missed']:.0f} missed",
        ),
        (
            "warnings",
            f"{f['warnings']:.0f}: {f['warnings_true']:.0f} true, {f['warnings_nuisance']:.0f} nuisance, "
            f"{f['warnings_false']:.0f} false ({f['false_per_100km']:.2f} per 100 km)",
        ),
        ("median lead time", f"{f['median_lead_time_s']:.2f} s"),
        ("lane recognised", _share(f["recognition_rate"])),
    ]
    if f["paper_recognition_rate"] == f["paper_recognition_rate"]:
        rows.append(("  published search", _share(f["paper_recognition_rate"])))
    rows += [
        (
            "lane errors (RMS)",
            f"{f['lateral_offset_rmse_m'] * 100:.1f} cm, {f['heading_rmse_rad'] * 1e3:.2f} mrad",
        ),
        (
            "TLC error below 1 s",
            f"median {f['tlc_error_median_s']:.2f} s, 95 % {f['tlc_error_p95_s']:.2f} s "
            f"(true state: {f['tlc_true_state_error_median_s']:.2f}, {f['tlc_true_state_error_p95_s']:.2f})",
        ),
    ]
    for label, value in rows:
        table.add_row(label, value)
    return table


def _predictions(f: dict[str, float]) -> Table:
    table = Table(
        title="lateral prediction error in m, median / 95th percentile", title_justify="left", box=None
    )
    table.add_column("")
    for horizon in HORIZONS_S:
        table.add_column(f"{horizon:.1f} s", justify="right")
    for label in ERRORS:
        cells = [
            f"{f[f'{label}_error_{h:.1f}s_median_m']:.3f} / {f[f'{label}_error_{h:.1f}s_p95_m']:.3f}"
            for h in HORIZONS_S
        ]
        table.add_row(_LABELS[label], *cells)
    return table


def _share(value: float) -> str:
    return f"{100.0 * value:.2f} % of frames"
