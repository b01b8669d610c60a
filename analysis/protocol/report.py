"""Test report: all trials as CSV, cells with their margins on the terminal."""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from analysis.protocol.running import Cell, Outcome

_DECIMALS = 3


def trial_table(outcome: Outcome) -> pd.DataFrame:
    """One row per attempt."""
    return pd.DataFrame([dataclasses.asdict(verdict) for verdict in outcome.verdicts])


def cell_table(outcome: Outcome) -> pd.DataFrame:
    """One row per cell."""
    return pd.DataFrame([dataclasses.asdict(cell) for cell in outcome.cells])


def write(outcome: Outcome, name: str, out: Path) -> None:
    """Write `NAME_trials.csv` and `NAME_cells.csv` into `out`."""
    out.mkdir(parents=True, exist_ok=True)
    for table, kind in ((trial_table(outcome), "trials"), (cell_table(outcome), "cells")):
        table = table.replace([math.inf, -math.inf], math.nan).round(_DECIMALS)
        table.to_csv(out / f"{name}_{kind}.csv", index=False)


def show(outcome: Outcome, name: str, console: Console) -> None:
    """Print the cells, the total, and the source of the values."""
    protocol = outcome.protocol
    console.print(f"{name}: {protocol.title}")
    table = Table(box=None)
    for heading in ("cell", "passed", "needed", "least margin", ""):
        table.add_column(heading, justify="left" if heading in ("cell", "") else "right")
    for cell in outcome.cells:
        verdict = "pass" if cell.ok else f"FAIL: {cell.why}"
        table.add_row(cell.name, f"{cell.passed} of {cell.trials}", str(cell.needed), _margin(cell), verdict)
    console.print(table)
    repeated = sum(not verdict.valid for verdict in outcome.verdicts)
    needed = f", {protocol.overall_share:.1%} needed" if protocol.overall_share else ""
    words = f", {repeated} invalid and repeated" if repeated else ""
    result = "PASSED" if outcome.passed else "FAILED"
    console.print(f"{name}: {result}: {outcome.share:.1%} of the trials passed{needed}{words}")
    if protocol.from_memory:
        console.print(f"Values from memory of: {protocol.source}")


def comparison_row(name: str, mode: str, model: str, outcome: Outcome) -> dict[str, object]:
    """Summary row of one protocol with one configuration."""
    least = least_margins(outcome.cells)
    return {
        "protocol": name,
        "mode": mode,
        "distance_model": model if outcome.protocol.collision else "",
        "passed": outcome.passed,
        "cells_passed": sum(cell.ok for cell in outcome.cells),
        "cells": len(outcome.cells),
        "trials_passed_share": round(outcome.share, _DECIMALS),
        "least_margin": ", ".join(f"{value:.2f} {unit}" for unit, value in least.items()),
    }


def write_comparison(rows: Iterable[Mapping[str, object]], out: Path) -> None:
    """`comparison.csv` in `out`."""
    pd.DataFrame(list(rows)).to_csv(out / "comparison.csv", index=False)


def least_margins(cells: Iterable[Cell]) -> dict[str, float]:
    """The least margin by its unit; −inf if an alert is missing."""
    least: dict[str, float] = {}
    for cell in cells:
        if cell.margin_unit and not math.isnan(cell.worst_margin):
            least[cell.margin_unit] = min(least.get(cell.margin_unit, math.inf), cell.worst_margin)
    return least


def comparison(rows: Iterable[Mapping[str, object]]) -> Table:
    """Rows of `comparison_row` as one table."""
    table = Table(box=None)
    for heading in ("protocol", "mode", "distance model", "result", "cells", "trials", "least margin"):
        table.add_column(heading)
    for row in rows:
        table.add_row(
            str(row["protocol"]),
            str(row["mode"]),
            str(row["distance_model"]),
            "passed" if row["passed"] else "FAILED",
            f"{row['cells_passed']} of {row['cells']}",
            f"{row['trials_passed_share']:.1%}",
            str(row["least_margin"]),
        )
    return table


def _margin(cell: Cell) -> str:
    if math.isnan(cell.worst_margin):
        return ""
    if math.isinf(cell.worst_margin):
        return "no alert"
    spread = "" if math.isnan(cell.spread_m) else f", spread {cell.spread_m:.2f} m"
    return f"{cell.worst_margin:+.2f} {cell.margin_unit}{spread}"
