"""Figures of a campaign, from the CSV files of its report."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.plots.run import PREDICTORS, add_errors, finish_errors, words
from analysis.plots.style import BLUE, GREY, SERIES, VERMILLION, blank_sheet, nothing, sheet, styled
from sumo_net.arrays import Array

RATES = {
    "departures": "departures",
    "departures_missed": "departures missed",
    "warnings": "lane warnings",
    "warnings_false": "false lane warnings",
    "warnings_nuisance": "nuisance lane warnings",
    "conflicts": "rear-end conflicts",
    "fcw_danger": "danger warnings",
    "fcw_danger_false": "false danger warnings",
}
SHARES = {
    "departures_warned": "departures warned",
    "conflicts_due_warned": "conflicts warned",
    "recognised": "lane recognised",
    "paper_recognised": "… by the published search",
}
TIMES = {
    "true_tlc": "true time to lane crossing in s",
    "true_ttc": "true time to collision in s",
    "ldw_lead_time": "from warning to crossing in s",
    "conflict_lead_time": "from warning to conflict in s",
    "conflict_min_ttc": "least true time to collision in s",
}
GREATEST_CELLS = 24  # more rows would not be legible


def cell_names(table: pd.DataFrame) -> "pd.Series[str]":
    """Names that distinguish the cells: the grid columns are those that are empty in the row of all cells."""
    whole = table["cell"].astype(str) == "all"
    grid = [
        c for c in table.columns if table.loc[whole, c].isna().all() and table.loc[~whole, c].notna().all()
    ]
    several = [column for column in grid if whole.any() and _vary(table.loc[~whole, column])]
    short = {column: words(str(column).replace(".", " ")) for column in several}
    names = []
    for row in table.to_dict("records"):
        parts = [f"{short[column]} {row[column]}" for column in several]
        names.append("all" if str(row["cell"]) == "all" else ", ".join(parts) or f"cell {row['cell']}")
    return pd.Series(names, index=table.index, dtype=str)


def _vary(values: "pd.Series[Any]") -> bool:
    return len(values) > 0 and bool((values != values.iloc[0]).any())


@styled
def rates(table: pd.DataFrame) -> Figure:
    """Events per 100 km by cell with exact Poisson intervals, from rates.csv."""
    if table.empty or "figure" not in table.columns:
        return blank_sheet("no run has finished")
    return _intervals(
        table.assign(
            value=table["per_100km"], low=table["per_100km_poisson_low"], high=table["per_100km_poisson_high"]
        ),
        RATES,
        "per 100 km",
    )


@styled
def shares(table: pd.DataFrame) -> Figure:
    """Departures and conflicts warned, lanes recognised, by cell with Wilson's intervals, from shares.csv."""
    if table.empty or "share" not in table.columns:
        return blank_sheet("nothing was counted that has a share")
    scaled = table.assign(value=100 * table["share"], low=100 * table["low"], high=100 * table["high"])
    return _intervals(scaled, SHARES, "%")


def _intervals(table: pd.DataFrame, figures: dict[str, str], unit: str) -> Figure:
    table = table.assign(name=cell_names(table))
    shown = [name for name in figures if table.loc[table["figure"] == name, "value"].notna().any()]
    names = list(dict.fromkeys(table["name"]))[:GREATEST_CELLS]
    if not shown:
        return blank_sheet("no events")
    rows = (len(shown) + 1) // 2
    height = rows * (0.95 + 0.22 * len(names))
    figure, grid = sheet(rows, 2, max(height, 2.2), width_in=9.0, sharey=True, squeeze=False)
    for axes in grid.flat[len(shown) :]:
        axes.set_axis_off()
    for name, axes in zip(shown, grid.flat, strict=False):
        part = table[table["figure"] == name].set_index("name").reindex(names)
        reach = [part["value"] - part["low"], part["high"] - part["value"]]
        colours = [BLUE if label != "all" else VERMILLION for label in names]
        for k, (value, colour) in enumerate(zip(part["value"], colours, strict=True)):
            error = [[max(reach[0].iloc[k], 0.0)], [max(reach[1].iloc[k], 0.0)]]
            marker = "o" if colour == BLUE else "D"
            axes.errorbar(value, k, xerr=np.nan_to_num(error), fmt=marker, color=colour, capsize=3)
        axes.set_title(figures[name])
        axes.set_xlabel(unit)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        if unit == "%":
            axes.set_xlim(None, min(101.0, axes.get_xlim()[1]))
        else:
            axes.set_xlim(0.0, None)
    return figure


@styled
def times(table: pd.DataFrame, figure_name: str) -> Figure:
    """Distribution of a time by cell, from times.csv: true_tlc, true_ttc, ldw_lead_time and others."""
    figure, axes = sheet(1, 1, 3.4)
    part = table[table["figure"] == figure_name] if "figure" in table.columns else table.iloc[:0]
    if figure_name == "true_tlc" and len(part):
        part = part[part["up_to_s"] > 0.0]  # 0: already outside
    if part.empty:
        nothing(axes, "no such time was counted")
        return figure
    part = part.assign(name=cell_names(part))
    names = [name for name in dict.fromkeys(part["name"]) if name != "all"][: len(SERIES)] or ["all"]
    for name, (colour, dashes, _) in zip(names, SERIES, strict=False):
        rows = part[part["name"] == name].sort_values("up_to_s")
        share = 100.0 * rows["count"].cumsum() / rows["count"].sum()
        axes.step(
            rows["up_to_s"],
            share,
            where="post",
            color=colour,
            linestyle=dashes,
            label=f"{name} (n = {rows['count'].sum()})",
        )
    axes.set(xlabel=TIMES.get(figure_name, words(figure_name)), ylabel="at or below, in %", ylim=(0.0, 101.0))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=1)
    return figure


@styled
def prediction(table: pd.DataFrame) -> Figure:
    """Lateral prediction error by horizon over all cells, from predictions.csv."""
    figure, (left, right) = sheet(1, 2, 3.5)
    part = table[table["cell"].astype(str) == "all"] if "cell" in table.columns else table
    if part.empty or "predictor" not in part.columns or not part["count"].sum():
        right.set_axis_off()
        nothing(left, "no prediction was made")
        return figure
    for name, label in PREDICTORS.items():
        rows = part[part["predictor"] == name].sort_values("horizon_s")
        add_errors(left, right, label, rows["horizon_s"], rows["median_m"], rows["p95_m"])
    finish_errors(figure, left, right)
    return figure


@styled
def roc(tables: dict[str, pd.DataFrame]) -> Figure:
    """Share of events warned against false warnings per 100 km over the threshold, from sweep_KIND.csv."""
    figure, both = sheet(1, 2, 3.4, width_in=7.0, squeeze=False)
    titles = {"ldw": "departures", "fcw": "conflicts"}
    for axes, (kind, what), (colour, dashes, marker) in zip(both.flat, titles.items(), SERIES, strict=False):
        table = tables.get(kind, pd.DataFrame())
        if table.empty or "hit_rate" not in table.columns:
            nothing(axes, f"no threshold sweep:\nsumo-adas sweep DIR --kind {kind}")
            continue
        if not table["events"].any():
            nothing(axes, f"no {what} were due a warning")
            continue
        unwanted = table["false_per_100km"] + table["nuisance_per_100km"]
        axes.plot(
            unwanted,
            100 * table["hit_rate"],
            color=colour,
            linestyle=dashes,
            marker=marker,
            markersize=4,
            label="false + nuisance",
        )
        axes.plot(
            table["false_per_100km"],
            100 * table["hit_rate"],
            color=GREY,
            linestyle=":",
            marker=".",
            label="false alone",
        )
        _name_thresholds(axes, unwanted.to_numpy(float), 100 * table["hit_rate"].to_numpy(float), table)
        axes.set(
            title=f"{what} warned in % of {table['events'].max()}",
            xlabel="unwanted warnings per 100 km",
            ylim=(-3, 104),
        )
        axes.legend(loc="lower right")
    return figure


def _name_thresholds(axes: Axes, x: Array, y: Array, table: pd.DataFrame) -> None:
    """Write the threshold beside its point, as far as there is room."""
    room, last = 0.12 * max(float(np.ptp(x)), 1e-9), -np.inf
    for at_x, at_y, threshold in zip(x, y, table["threshold_s"], strict=True):
        if abs(at_x - last) >= room:
            axes.annotate(f"{threshold:g} s", (at_x, at_y), (3, -11), textcoords="offset points", fontsize=8)
            last = at_x


@styled
def benefit(table: pd.DataFrame) -> Figure:
    """Events per run that reacting drivers avoid, with bootstrap intervals, from benefit.csv."""
    if table.empty or "avoided_per_run" not in table.columns:
        return blank_sheet("no pair of cells with reaction.on false and true")
    labels = []
    several = [c for c in table.columns[: list(table.columns).index("figure")] if _vary(table[c])]
    for row in table.to_dict("records"):
        grid = [f"{words(str(k).replace('.', ' '))} {row[k]}" for k in several]
        labels.append("\n".join([words(str(row["figure"])), *grid]))
    figure, axes = sheet(1, 1, max(2.0, 0.6 + 0.5 * len(table)), width_in=6.0)
    value = table["avoided_per_run"]
    reach = np.nan_to_num([value - table["avoided_per_run_low"], table["avoided_per_run_high"] - value]).clip(
        0.0
    )
    axes.errorbar(value, range(len(table)), xerr=reach, fmt="o", color=BLUE, capsize=3)
    for k, (avoided, without) in enumerate(zip(table["avoided"], table["without"], strict=True)):
        axes.annotate(
            f"{avoided} of {without}",
            (float(value.iloc[k]), k),
            (0, 7),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )
    axes.axvline(0.0, color=GREY, linewidth=1)
    axes.set_yticks(range(len(table)), labels)
    axes.set_ylim(len(table) - 0.5, -0.6)
    axes.set_xlabel("avoided a run")
    return figure


@styled
def error_times(table: pd.DataFrame) -> Figure:
    """Errors of the times to crossing and collision, from accuracy.csv: median and 95th percentile."""
    figure, axes = sheet(1, 1, 2.6)
    names = {"tlc_error": "TLC", "tlc_true_state_error": "TLC from the true state", "ttc_error": "TTC"}
    wanted = [f"{name}_{end}_s" for name in names for end in ("median", "p95")]
    part = table[table["cell"].astype(str) == "all"] if "cell" in table.columns else table
    if part.empty or not set(wanted) <= set(part.columns):
        nothing(axes, "no times were counted")
        return figure
    row = part.iloc[0]
    median, p95 = (np.array([row[f"{name}_{end}_s"] for name in names], float) for end in ("median", "p95"))
    shown = np.flatnonzero(np.isfinite(median))
    if not len(shown):
        nothing(axes, "no times were counted")
        return figure
    axes.hlines(shown, median[shown], np.where(np.isfinite(p95), p95, median)[shown], color=BLUE)
    axes.plot(median[shown], shown, "o", color=BLUE, label="median")
    axes.plot(p95[shown], shown, "|", color=VERMILLION, markersize=12, label="95th percentile")
    axes.set_yticks(range(len(names)), list(names.values()))
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlabel("error in s")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.25), ncols=2)
    return figure
