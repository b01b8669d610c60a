"""Figures of the three published sources, drawn from the curves that `sumo-adas reproduce` writes."""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from analysis.plots.style import BLACK, GREY, ORANGE, SERIES, SKY, VERMILLION, sheet, styled

LANE_M = 3.75  # lane width of the road runs
_STEADY_CASES = {
    "known": "R known",
    "too_small": "given R/25",
    "too_large": "given 25 R",
    "changing": "R grows ninefold",
}
_FILTERS = {
    "fixed": "fixed R",
    "adaptive": "adaptive, safe form",
    "patent_r": "as published, adapting R",
    "patent": "as published, adapting Q and R",
}
_MANOEUVRE_S = 10.0
_CHAINS = {"paper": ("published chain", VERMILLION, "--"), "refined": ("default chain", ORANGE, "-.")}
PATH_STYLES = {"driven": ("driven", SKY, "-")} | _CHAINS


@styled
def correction(curve: pd.DataFrame) -> Figure:
    """The factor f from kinematic to dynamic front-wheel angle, over speed and load (Z11 figure 13)."""
    figure, axes = sheet(1, 1, 3.4)
    for (load, part), (colour, dashes, _) in zip(curve.groupby("load", sort=False), SERIES, strict=False):
        axes.plot(part["speed_kmh"], part["factor"], color=colour, linestyle=dashes, label=str(load))
    printed = curve.dropna(subset="factor_printed").iloc[9::10]
    axes.plot(printed["speed_kmh"], printed["factor_printed"], "k+", label="printed, half load")
    axes.set(xlabel="speed in km/h", ylabel="correction factor f", xlim=(0, 150), ylim=(1.0, None))
    axes.legend(loc="upper left")
    return figure


@styled
def observer(curve: pd.DataFrame) -> Figure:
    """Yaw rate and lateral speed of the simulated vehicle and of the observers (Z11 figures 14 to 16)."""
    runs = list(curve["run"].unique())
    figure, grid = sheet(2, len(runs), 5.2, width_in=9.6, sharex="col", squeeze=False)
    names: list[str] = list(curve["observer"].unique())
    for column, run in enumerate(runs):
        of_run = curve[curve["run"] == run]
        first = of_run[of_run["observer"] == of_run["observer"].iloc[0]]
        for axes, value in zip(grid[:, column], ("yaw_rate_rps", "lateral_speed_mps"), strict=True):
            axes.plot(
                first["time_s"], first[f"true_{value}"], color=SKY, linewidth=4, label="simulated vehicle"
            )
            for name in names:
                part = of_run[of_run["observer"] == name]
                colour, dashes, _ = SERIES[(1 + names.index(name)) % len(SERIES)]
                if len(part):
                    label = name.replace("paper", "published observer").replace("refined", "default observer")
                    axes.plot(part["time_s"], part[value], color=colour, linestyle=dashes, label=label)
        grid[0, column].set_title(run)
        grid[1, column].set_xlabel("time in s")
    grid[0, 0].set_ylabel("yaw rate γ in rad/s")
    grid[1, 0].set_ylabel("lateral speed v_y in m/s")
    _shared_legend(figure, grid[0])
    return figure


@styled
def road(steps: pd.DataFrame, paths: pd.DataFrame) -> Figure:
    """Borders, true and observed position, path 2 s ahead, of the road runs (Z11 figures 17 to 19)."""
    runs = list(steps["run"].unique())
    figure, grid = sheet(2, len(runs), 5.4, width_in=9.6, squeeze=False)
    for column, run in enumerate(runs):
        place, ahead = grid[0, column], grid[1, column]
        first = steps[(steps["run"] == run) & (steps["car"] == 0)]
        truth = first[first["chain"] == first["chain"].iloc[0]]
        for border, label in ((0.5, "lane borders"), (-0.5, None)):
            place.axhline(border * LANE_M, color=BLACK, linewidth=1.4, label=label)
        place.plot(truth["time_s"], truth["true_lateral_offset_m"], color=SKY, linewidth=4, label="driven")
        driven = paths[(paths["run"] == run) & (paths["path"] == "driven")]
        ahead.plot(driven["forward_m"], driven["left_m"], color=SKY, linewidth=4)
        for chain, (label, colour, dashes) in _CHAINS.items():
            seen = first[first["chain"] == chain]
            place.plot(seen["time_s"], seen["lateral_offset_m"], color=colour, linestyle=dashes, label=label)
            path = paths[(paths["run"] == run) & (paths["path"] == chain)]
            ahead.plot(path["forward_m"], path["left_m"], color=colour, linestyle=dashes)
        place.set(title=run, xlabel="time in s", ylim=(-2.4, 2.4))
        ahead.set(xlabel="ahead in m")
    grid[0, 0].set_ylabel("left of lane centre in m:\ndriven and observed")
    grid[1, 0].set_ylabel("left in m: driven in the\nnext 2 s and predicted")
    _shared_legend(figure, grid[0])
    return figure


@styled
def imm(curve: pd.DataFrame) -> Figure:
    """RMSE over the runs at every scan of constant velocity, constant acceleration, and the IMM of both."""
    figure, all_axes = sheet(4, 1, 7.2, width_in=6.0, sharex=True)
    rows = (
        ("range_m", "RMSE of\nrange in m"),
        ("range_rate_mps", "RMSE of range\nrate in m/s"),
        ("azimuth_deg", "RMSE of\nazimuth in °"),
    )
    names = {"cv": "constant velocity", "ca": "constant acceleration", "imm": "IMM"}
    for axes, (column, label) in zip(all_axes, rows, strict=False):
        for (name, words), (colour, dashes, _) in zip(names.items(), SERIES, strict=False):
            part = curve[curve["filter"] == name]
            axes.plot(part["time_s"], part[column], color=colour, linestyle=dashes, label=words)
        axes.set_ylabel(label)
        axes.set_ylim(0.0, None)
    part = curve[curve["filter"] == "imm"]
    all_axes[-1].plot(part["time_s"], part["probability_cv"], color=SERIES[2][0], linestyle=SERIES[2][1])
    all_axes[-1].set(xlabel="time in s", ylabel="mean probability\nof constant velocity", ylim=(0.0, 1.0))
    for axes in all_axes:
        axes.axvline(_MANOEUVRE_S, color=GREY, linewidth=1)
    all_axes[0].annotate(
        "manoeuvre begins",
        (_MANOEUVRE_S, 0.9),
        (-4, 0),
        ha="right",
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
    )
    _shared_legend(figure, all_axes[:1])
    return figure


@styled
def adaptive(curve: pd.DataFrame) -> Figure:
    """RMSE of the speed over ground, and estimated over true R, by the initial R given to the filters."""
    figure, grid = sheet(2, len(_STEADY_CASES), 4.8, width_in=9.6, sharex=True, sharey="row")
    for column, (case, title) in enumerate(_STEADY_CASES.items()):
        for (name, label), (colour, dashes, _) in zip(_FILTERS.items(), SERIES, strict=False):
            part = curve[(curve["case"] == case) & (curve["filter"] == name)]
            if part.empty:  # every run diverged
                continue
            style = {"color": colour, "linestyle": dashes, "label": label}
            grid[0, column].plot(part["time_s"], part["rmse_vx_mps"], **style)
            grid[1, column].plot(part["time_s"], part["r_ratio_v"].clip(lower=1e-2), **style)
        grid[0, column].set(title=title, ylim=(0.0, 1.5))
        grid[1, column].set(xlabel="time in s", yscale="log", ylim=(1e-2, 1e2))
        grid[1, column].yaxis.set_major_formatter("{x:g}")
        grid[1, column].yaxis.set_minor_formatter(NullFormatter())
    grid[0, 0].set_ylabel("RMSE of ẋ in m/s,\nruns not diverged")
    grid[1, 0].set_ylabel("mean R of v_r\nover the true one")
    _shared_legend(figure, grid[0])
    return figure


@styled
def recognition(rate: pd.DataFrame) -> Figure:
    """Share of frames with the lane found, and the source's values (Z11 conclusion 1)."""
    groups = list(dict.fromkeys(zip(rate["scenario"], rate["condition"], strict=True)))
    named = rate.set_index(["chain", "scenario", "condition"])["recognised_percent"]
    figure, axes = sheet(1, 1, 3.4)
    for shift, (chain, (label, colour, _)) in zip((-0.2, 0.2), _CHAINS.items(), strict=True):
        of_chain = [named[chain, *group] for group in groups]
        bars = axes.bar([k + shift for k in range(len(groups))], of_chain, 0.4, label=label, color=colour)
        axes.bar_label(bars, fmt="%.1f", padding=3)
    said = rate.groupby(["scenario", "condition"])["published_percent"].first()
    for k, group in enumerate(groups):
        axes.hlines(said[group], k - 0.45, k + 0.45, BLACK, "--", label="_" if k else "published")
    axes.set_xticks(range(len(groups)), [f"{scenario}\n{condition}" for scenario, condition in groups])
    axes.set(ylabel="frames recognised in %", ylim=(0, 115))
    _shared_legend(figure, [axes])
    return figure


@styled
def search_times(measured: pd.DataFrame) -> Figure:
    """Time of the genetic search per frame, both borders, and the source's values (Z11 table 4)."""
    of_class = measured.groupby("class", sort=False)[["published_ms", "ms"]].median()
    figure, axes = sheet(1, 1, 3.2)
    for shift, column, label, colour in (
        (-0.2, "published_ms", "published", GREY),
        (0.2, "ms", "here", ORANGE),
    ):
        bars = axes.bar(
            [k + shift for k in range(len(of_class))], of_class[column], 0.4, label=label, color=colour
        )
        axes.bar_label(bars, fmt="%.3g")
    axes.set_xticks(range(len(of_class)), list(of_class.index))
    axes.set(yscale="log", ylabel="ms per frame, both borders", ylim=(None, 600))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend()
    return figure


def _shared_legend(figure: Figure, all_axes: Iterable[Axes]) -> None:
    """One legend below for all axes."""
    found: dict[str, Any] = {}
    for axes in all_axes:
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=3, handlelength=3)


class Published(NamedTuple):
    """The figure of an experiment."""

    files: tuple[str, ...]  # written by the experiment, in the order of draw's arguments
    draw: Callable[..., Figure]


FIGURES = {
    "simulation": Published(("simulation_curves.csv",), observer),
    "road": Published(("road_steps.csv", "road_paths.csv"), road),
    "recognition": Published(("recognition.csv",), recognition),
    "search-times": Published(("search-times.csv",), search_times),
    "correction": Published(("correction_curves.csv",), correction),
    "imm": Published(("imm_curves.csv",), imm),
    "adaptive": Published(("adaptive_curves.csv",), adaptive),
}
