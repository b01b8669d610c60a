"""Figures of the three published sources, drawn from what `sumo-adas reproduce` computes."""

import dataclasses

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from analysis.plots.style import GREY, SERIES, sheet, styled
from analysis.published.adaptive import FILTERS, TOLD
from analysis.published.imm import PHASES
from sumo_net.vehicle import Vehicle

LOADS_KG = {"empty": 960.0, "half load": 1215.0, "full load": 1460.0}


@styled
def correction_factor(vehicle: Vehicle | None = None) -> Figure:
    """The factor f = 1 + K_u v²/L from the kinematic to the dynamic front-wheel angle, over speed and load."""
    vehicle = vehicle or Vehicle()
    figure, axes = sheet(1, 1, 3.4)
    speed_kmh = np.linspace(0.0, 130.0, 131)
    for (label, mass_kg), (colour, dashes, _) in zip(LOADS_KG.items(), SERIES, strict=False):
        loaded = dataclasses.replace(vehicle, mass_kg=mass_kg)
        factor = 1.0 + loaded.understeer * np.square(speed_kmh / 3.6) / loaded.wheelbase_m
        axes.plot(speed_kmh, factor, color=colour, linestyle=dashes, label=f"{label}, {mass_kg:.0f} kg")
    axes.set(xlabel="speed in km/h", ylabel="correction factor f", xlim=(0, 130), ylim=(1.0, None))
    axes.legend(loc="upper left")
    return figure


@styled
def imm(curve: pd.DataFrame) -> Figure:
    """RMSE over the runs at every scan: constant velocity, constant acceleration, and the IMM of both."""
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
    all_axes[-1].plot(part["time_s"], part["probability_cv"], color=SERIES[2][0])
    all_axes[-1].set(xlabel="time in s", ylabel="mean probability\nof constant velocity", ylim=(0.0, 1.0))
    for axes in all_axes:
        axes.axvline(PHASES["manoeuvre"][0], color=GREY, linewidth=1)
    all_axes[0].annotate("manoeuvre begins", (PHASES["manoeuvre"][0], 0.9), (-4, 0), ha="right",
                         xycoords=("data", "axes fraction"), textcoords="offset points")  # fmt: skip
    figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@styled
def adaptive(curve: pd.DataFrame) -> Figure:
    """RMSE of the speed over ground and the R found over the true one, by what the filters were told."""
    figure, grid = sheet(2, len(TOLD), 4.8, width_in=9.0, sharex=True, sharey="row")
    titles = {
        "known": "R known",
        "too_small": "told R/25",
        "too_large": "told 25 R",
        "changing": "R grows ninefold",
    }
    for column, case in enumerate(TOLD):
        for name, (colour, dashes, _) in zip(FILTERS, SERIES, strict=False):
            part = curve[(curve["case"] == case) & (curve["filter"] == name)]
            if part.empty:  # every run diverged
                continue
            label = name.replace("_", ", adapting ").replace("patent, adapting r", "patent, adapting R")
            style = {"color": colour, "linestyle": dashes, "label": label}
            grid[0, column].plot(part["time_s"], part["rmse_vx_mps"], **style)
            grid[1, column].plot(part["time_s"], part["r_ratio_v"].clip(lower=1e-2), **style)
        grid[0, column].set(title=titles[case], ylim=(0.0, 1.5))
        grid[1, column].set(xlabel="time in s", yscale="log", ylim=(1e-2, 1e2))
    grid[0, 0].set_ylabel("RMSE of ẋ in m/s,\nruns not diverged")
    grid[1, 0].set_ylabel("mean R of v_r\nover the true one")
    found: dict[str, object] = {}
    for axes in grid[0]:
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=4)
    return figure
