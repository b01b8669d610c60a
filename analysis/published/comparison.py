"""Published figures beside measured ones: the one table that every experiment ends in.

`basis` says what stands under `published`: *printed* in the source; *checked*, recomputed by an independent
reference because the source prints only curves or misprints the number; *claim*, a bound the source claims
in words; empty where the source shows a figure without numbers, so that there is nothing to compare with.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

COLUMNS = ("run", "figure", "unit", "basis", "published", "measured", "difference", "holds")
BASES = ("printed", "checked", "claim", "")


def row(
    run: str, figure: str, unit: str, measured: float, published: float = np.nan, basis: str = ""
) -> dict[str, Any]:
    """One figure. With a number of the source, `basis` must say whether it is printed or checked."""
    if basis not in BASES or (basis == "") != np.isnan(published):
        raise ValueError(f"basis = {basis!r} with published = {published}: one of {BASES[:3]} with a number")
    return {
        "run": run,
        "figure": figure,
        "unit": unit,
        "basis": basis,
        "published": published,
        "measured": measured,
        "difference": measured - published,
        "holds": "",
    }


def claim(
    run: str, figure: str, unit: str, measured: float, bound: float, at_most: bool = True
) -> dict[str, Any]:
    """One figure that the source bounds in words; `holds` is yes or no."""
    holds = measured <= bound if at_most else measured >= bound
    return row(run, figure, unit, measured, bound, "claim") | {
        "figure": f"{figure} ({'at most' if at_most else 'at least'})",
        "holds": "yes" if holds else "no",
    }


def table(rows: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """The rows as a table with COLUMNS."""
    return pd.DataFrame(list(rows), columns=list(COLUMNS))


def write(out: Path, name: str, tables: Mapping[str, pd.DataFrame], comparison: pd.DataFrame) -> pd.DataFrame:
    """What an experiment leaves in `out`: its tables, its figure <name>.png and <name>_comparison.csv.

    tables : by their files' names, among them those of the figure. The comparison goes on.
    """
    from analysis.plots.published import FIGURES  # matplotlib is slow to import
    from analysis.plots.style import save

    out.mkdir(parents=True, exist_ok=True)
    for file, table in {**tables, f"{name}_comparison.csv": comparison}.items():
        table.to_csv(out / file, index=False, float_format="%.6g")
    figure = FIGURES[name]
    save(figure.draw(*(tables[file] for file in figure.files)), out / f"{name}.png", "png")
    return comparison


def text(comparison: pd.DataFrame) -> str:
    """The table for a terminal; what is not known is left blank."""
    shown = comparison.copy()
    for name in ("published", "measured", "difference"):
        shown[name] = [_number(value, name == "difference") for value in comparison[name]]
    return str(shown.to_string(index=False))


def markdown(comparison: pd.DataFrame) -> str:
    """The table for a page."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    for entry in comparison.to_dict("records"):
        cells = [
            _number(entry[name], name == "difference") if isinstance(entry[name], float) else str(entry[name])
            for name in COLUMNS
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _number(value: float, signed: bool = False) -> str:
    if np.isnan(value):
        return ""
    return f"{value:+.3g}" if signed else f"{value:.4g}"
