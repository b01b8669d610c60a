"""Table of published and measured figures, the result of every experiment.

`basis` is the kind of the value `published`: *printed* in the source; *checked*, recomputed by an independent
reference because the source prints only curves or misprints the number; *claim*, a bound that the source
states in words; empty where the source has a figure without numbers, so that there is nothing to compare.
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
    """One figure for which the source states a bound in words; `holds` is yes or no."""
    holds = measured <= bound if at_most else measured >= bound
    return row(run, figure, unit, measured, bound, "claim") | {
        "figure": f"{figure} ({'at most' if at_most else 'at least'})",
        "holds": "yes" if holds else "no",
    }


def table(rows: Iterable[dict[str, Any]]) -> pd.DataFrame:
    """The rows as a table with COLUMNS."""
    return pd.DataFrame(list(rows), columns=list(COLUMNS))


def write(out: Path, name: str, tables: Mapping[str, pd.DataFrame], comparison: pd.DataFrame) -> pd.DataFrame:
    """Write an experiment's tables, its figure <name>.png and <name>_comparison.csv into `out`.

    tables : by file name, including those of the figure. Returns the comparison.
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
    """The table for a terminal; unknown values are blank."""
    shown = comparison.copy()
    for name in ("published", "measured", "difference"):
        shown[name] = [_number(value, name == "difference") for value in comparison[name]]
    return str(shown.to_string(index=False))


def markdown(comparison: pd.DataFrame) -> str:
    """The table in Markdown."""
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
