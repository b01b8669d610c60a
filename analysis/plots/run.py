"""Figures of a run, from its tables: accuracy of lane, prediction and times, warnings, motion classes."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.metrics import CATEGORIES, NEAR_TLC_S, before_crossing, category, prediction_errors
from analysis.plots.style import BLUE, GREY, SERIES, VERMILLION, below, nothing, sheet, styled
from analysis.rear_end import NEAR_TTC_S, settled
from analysis.statistics import clustered_share
from plugin.tracking.classification import NAMES
from plugin.truth import HORIZONS_S

PREDICTORS = {
    "predicted": "predicted path",
    "true_state": "same, from the true state",
    "constant_velocity": "constant lateral velocity",
    "constant_radius": "constant turn radius",
}
_TLC = {
    "tlc_s": "predicted path",
    "tlc_true_state_s": "same, from the true state",
    "tlc_constant_velocity_s": "constant lateral velocity",
    "tlc_constant_radius_s": "constant turn radius",
}
OUTCOMES = {"true": (BLUE, ""), "nuisance": ("#F0E442", "//"), "false": (VERMILLION, "xx")}


def words(name: str) -> str:
    """A table's word in plain spelling."""
    return name.replace("_", " ")


def add_errors(
    left: Axes, right: Axes, label: str, horizon_s: pd.Series, median_m: pd.Series, p95_m: pd.Series
) -> None:
    """Draw one predictor's |lateral error| by horizon, (H,) each: median on the left, p95 on the right."""
    colour, dashes, marker = SERIES[len(left.lines)]
    for axes, error_m in ((left, median_m), (right, p95_m)):
        axes.plot(
            horizon_s,
            100.0 * error_m,
            color=colour,
            linestyle=dashes,
            marker=marker,
            markersize=4,
            label=label,
        )


def finish_errors(figure: Figure, left: Axes, right: Axes) -> None:
    """Add titles, axes and legend to a figure of `add_errors`."""
    left.set(title="median", ylabel="lateral error in cm")
    right.set(title="95th percentile")
    for axes in (left, right):
        axes.set(xlabel="horizon in s", xticks=HORIZONS_S, ylim=(0.0, None))
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2, handlelength=2.6)


@styled
def prediction_error(predictions: pd.DataFrame) -> Figure:
    """|Lateral error| of the predicted path by horizon, median and 95th percentile, against baselines."""
    figure, (left, right) = sheet(1, 2, 3.5)
    if predictions.empty:
        right.set_axis_off()
        nothing(left, "no prediction was made")
        return figure
    table = prediction_errors(predictions)
    for name, label in PREDICTORS.items():
        add_errors(left, right, label, table["horizon_s"], table[f"{name}_median_m"], table[f"{name}_p95_m"])
    finish_errors(figure, left, right)
    return figure


@styled
def prediction_by_category(predictions: pd.DataFrame, steps: pd.DataFrame) -> Figure:
    """Median |lateral error| 1 s and 2 s ahead, by driver action and road curvature."""
    figure, both = sheet(2, 1, 4.2, sharex=True)
    if predictions.empty or steps.empty:
        both[1].set_axis_off()
        nothing(both[0], "no prediction was made")
        return figure
    table = prediction_errors(predictions, steps)
    table = table[(table["category"] != "all") & (table["count"] > 0)]
    for axes, horizon in zip(both, (1.0, 2.0), strict=True):
        part = table[table["horizon_s"] == horizon].set_index("category")
        place = np.arange(len(part))
        for k, ((name, label), (colour, _, _)) in enumerate(zip(PREDICTORS.items(), SERIES, strict=False)):
            hatch = ("", "....", "////", "xx")[k]
            axes.bar(
                place + 0.2 * (k - 1.5),
                100.0 * part[f"{name}_median_m"],
                width=0.2,
                color=colour,
                hatch=hatch,
                edgecolor="white",
                label=label,
            )
        axes.set(title=f"{horizon:.0f} s ahead", ylabel="median in cm")
        names = [f"{words(str(name))}\nn = {count}" for name, count in part["count"].items()]
        axes.set_xticks(place, names)
        axes.grid(axis="x", visible=False)
    figure.legend(*both[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@styled
def recognition(steps: pd.DataFrame) -> Figure:
    """Share of frames with the lane recognised, by category, with a 95 % bootstrap interval over vehicles."""
    figure, axes = sheet(1, 1, 2.8)
    judged = steps[steps["on_marked_road"].fillna(False) & steps["recognised"].notna()]
    if judged.empty:
        nothing(axes, "no frame was scored: no marked road, or no equipped vehicle")
        return figure
    of = category(judged)
    names = [name for name in CATEGORIES if (of == name).any()]
    chains = {"recognised": ("default chain", 0), "paper_recognised": ("published search", 1)}
    for column, (label, index) in chains.items():
        if judged[column].isna().all():
            continue
        colour, _, marker = SERIES[index]
        rows = [judged[(of == name) & judged[column].notna()] for name in names]
        shares = np.array([clustered_share(part, column) for part in rows])
        y = np.arange(len(names)) - 0.15 + 0.3 * index
        reach = np.nan_to_num(np.abs(shares[:, 1:] - shares[:, :1]).T)
        axes.errorbar(
            100 * shares[:, 0], y, xerr=100 * reach, fmt=marker, color=colour, capsize=3, label=label
        )
        for k, share in enumerate(shares[:, 0]):
            axes.annotate(
                f"{_percent(share)}", (100 * share, y[k]), (0, 6), textcoords="offset points", ha="center"
            )
    counts = of.value_counts()
    axes.set_yticks(range(len(names)), [f"{words(name)} ({counts[name]})" for name in names])
    axes.set_ylim(len(names) - 0.4, -0.7)
    axes.set_xlabel("recognised frames in % (frames in brackets)")
    least = axes.get_xlim()[0]
    axes.set_xlim(min(least, 95.0), 100.0 + 0.08 * (100.0 - min(least, 95.0)))
    below(axes, lift=-0.22)
    return figure


@styled
def tlc_error(steps: pd.DataFrame) -> Figure:
    """Share of steps with a |TLC error| of at most x, where the true TLC is under NEAR_TLC_S."""
    figure, axes = sheet(1, 1, 3.4)
    near = before_crossing(steps)
    if near.empty:
        nothing(axes, f"no vehicle came within {NEAR_TLC_S:g} s of a crossing")
        return figure
    for (column, label), (colour, dashes, _) in zip(_TLC.items(), SERIES, strict=False):
        error = np.sort((near[column] - near["true_tlc_s"]).abs().dropna().to_numpy())
        # crossings that were not predicted have no finite error: the curve ends below 100 %
        share = 100.0 * np.arange(1, len(error) + 1) / len(near)
        axes.step(error, share, where="post", color=colour, linestyle=dashes, label=label)
    axes.set(
        xlabel="error of the time to lane crossing in s",
        ylabel=f"steps at or below, in % of {len(near)}",
        xlim=(0.0, 1.0),
        ylim=(0.0, 101.0),
    )
    below(axes)
    return figure


@styled
def ttc_error(steps: pd.DataFrame) -> Figure:
    """Estimated against true time to collision, where that is short and the leader is in view."""
    below_s = 2 * NEAR_TTC_S
    figure, axes = sheet(1, 1, 3.4)
    near = steps[(steps["true_ttc_s"] < below_s) & steps["true_leader_visible"].fillna(False)]
    if near.empty:
        nothing(axes, f"no time to collision fell under {below_s:g} s")
        return figure
    known = near[near["fcw_ttc_s"].notna()]
    axes.plot([0, below_s], [0, below_s], color=GREY, linewidth=1, label="no error")
    axes.scatter(
        known["true_ttc_s"],
        known["fcw_ttc_s"],
        s=9,
        color=BLUE,
        alpha=0.5,
        rasterized=True,
        linewidths=0,
        label=f"{len(known)} steps; {len(near) - len(known)} more without an estimate",
    )
    axes.set(
        xlabel="true time to collision in s",
        ylabel="estimated, in s",
        xlim=(0.0, below_s),
        ylim=(0.0, 1.5 * below_s),
    )
    below(axes)
    return figure


@styled
def warning_outcomes(warnings: pd.DataFrame) -> Figure:
    """Warnings by kind, level and outcome."""
    figure, axes = sheet(1, 1, 2.4)
    if warnings.empty:
        nothing(axes, "no warning was given")
        return figure
    rows = (
        ("lane departure", "ldw", "warning"),
        ("reminder", "fcw", "reminder"),
        ("danger", "fcw", "danger"),
    )
    start = np.zeros(len(rows))
    for outcome, (colour, hatch) in OUTCOMES.items():
        counts = np.array(
            [
                (
                    (warnings["kind"] == kind)
                    & (warnings["level"] == level)
                    & (warnings["outcome"] == outcome)
                ).sum()
                for _, kind, level in rows
            ]
        )
        bars = axes.barh(
            range(len(rows)), counts, left=start, color=colour, hatch=hatch, edgecolor="white", label=outcome
        )
        axes.bar_label(bars, [f"{n}" if n else "" for n in counts], label_type="center", backgroundcolor="w")
        start += counts
    axes.set_yticks(range(len(rows)), [label for label, _, _ in rows])
    axes.invert_yaxis()
    axes.set_xlabel("warnings")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.grid(axis="y", visible=False)
    below(axes, 3, -0.28)
    return figure


@styled
def motion_classes(tracks: pd.DataFrame) -> Figure:
    """Estimated by true motion class of radar tracks, after the third cycle."""
    figure, axes = sheet(1, 1, 3.6)
    judged = settled(tracks)
    if judged.empty:
        nothing(axes, "no track lasted long enough to be scored")
        return figure
    counts = pd.crosstab(judged["true_motion_state"], judged["motion_state"])
    counts = counts.reindex(index=NAMES, columns=NAMES, fill_value=0)
    if not counts.to_numpy().sum():
        nothing(axes, "no track has both classes")
        return figure
    return _confusion(figure, axes, counts)


def _confusion(figure: Figure, axes: Axes, counts: pd.DataFrame) -> Figure:
    counts = counts.loc[counts.sum(axis=1) > 0, :]
    counts = counts.loc[:, (counts.sum(axis=0) > 0) | counts.columns.isin(counts.index)]
    share = counts.div(counts.sum(axis=1), axis=0).to_numpy()
    number = counts.to_numpy()
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, j), value in np.ndenumerate(share):
        axes.text(
            j,
            i,
            f"{_percent(value)} %\n{int(number[i, j])}",
            ha="center",
            va="center",
            color="white" if value > 0.6 else "#1a1a1a",
            fontsize=8,
        )
    axes.set_xticks(range(len(counts.columns)), [_broken(str(name)) for name in counts.columns], fontsize=8)
    axes.set_yticks(range(len(counts)), [_broken(str(name)) for name in counts.index], fontsize=8)
    axes.set(xlabel="taken for", ylabel="true class")
    axes.grid(visible=False)
    return figure


def _percent(share: float) -> str:
    """In %, never rounded up to 100."""
    return "100" if share == 1.0 else f"{min(100.0 * share, 99.99):.2f}" if share else "0"


def _broken(name: str) -> str:
    return words(name).replace("stopped was ", "stopped,\nwas ").replace("same direction", "same\ndirection")
