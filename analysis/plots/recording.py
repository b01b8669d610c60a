"""Figures of recorded drives, from lanes.csv of `detect` and tracks.csv of `track`."""

import pandas as pd
from matplotlib.figure import Figure

from analysis.plots.run import words
from analysis.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    blank_sheet,
    nothing,
    sheet,
    styled,
)

CLASSES = {
    "unclassified": (GREY, "."),
    "stationary": ("#4d4d4d", "s"),
    "same_direction": (BLUE, "o"),
    "oncoming": (VERMILLION, "^"),
    "stopped_was_same_direction": (SKY, "D"),
    "stopped_was_oncoming": (ORANGE, "v"),
}
MOST_POINTS = 6000


@styled
def lanes(table: pd.DataFrame) -> Figure:
    """Offset, heading, curvature, width and score of the lane detected in footage, over time."""
    if table.empty or "lane_locked" not in table.columns:
        return blank_sheet("no frame was processed")
    figure, all_axes = sheet(5, 1, 7.0, width_in=7.0, sharex=True)
    shown = (
        ("lateral_offset_m", "left of lane\ncentre in m", BLUE),
        ("heading_error_rad", "heading\nerror in rad", GREEN),
        ("curvature_1pm", "curvature\nin 1/m", PURPLE),
        ("lane_width_m", "lane width\nin m", ORANGE),
        ("lane_score", "score", GREY),
    )
    locked = table["lane_locked"].astype(str).isin(("1", "True", "true"))
    marker = "o" if len(table) < 60 else None
    for axes, (column, label, colour) in zip(all_axes, shown, strict=True):
        if column not in table.columns:
            nothing(axes, f"no column {column}")
            continue
        value = pd.to_numeric(table[column], errors="coerce")
        if column != "lane_score":
            value = value.where(locked)
        axes.plot(table["time_s"], value, color=colour, marker=marker, markersize=3)
        axes.set_ylabel(label)
    all_axes[0].set_title(f"lane found in {locked.sum()} of {len(table)} frames")
    all_axes[-1].set(xlabel="time in s", ylim=(-0.05, 1.05))
    return figure


@styled
def tracks(table: pd.DataFrame) -> Figure:
    """Range, range rate and azimuth of radar tracks over time, by motion class; tracks in path are ringed."""
    needed = {"time_s", "track_id", "range_m", "range_rate_mps", "azimuth_rad", "motion_state"}
    if table.empty or not needed <= set(table.columns):
        return blank_sheet("no tracks, or a table of another version")
    figure, all_axes = sheet(3, 1, 7.0, width_in=7.0, sharex=True)
    step = max(len(table) // MOST_POINTS, 1)
    some = table.iloc[::step]
    in_path = some[some["in_path"].astype(str).isin(("1", "True", "true"))] if "in_path" in some else some[:0]
    for axes, (column, label) in zip(
        all_axes,
        (
            ("range_m", "range in m"),
            ("range_rate_mps", "range rate in m/s"),
            ("azimuth_rad", "azimuth in rad"),
        ),
        strict=True,
    ):
        for name, (colour, marker) in CLASSES.items():
            part = some[some["motion_state"] == name]
            if len(part):
                axes.scatter(
                    part["time_s"],
                    part[column],
                    s=9,
                    color=colour,
                    marker=marker,
                    linewidths=0,
                    label=words(name),
                    rasterized=True,
                )
        if len(in_path):
            axes.scatter(
                in_path["time_s"],
                in_path[column],
                s=26,
                facecolors="none",
                edgecolors="#1a1a1a",
                linewidths=0.5,
                rasterized=True,
                label="in path",
            )
        axes.set_ylabel(label)
    every = f", one row in {step} drawn" if step > 1 else ""
    all_axes[0].set_title(f"{table['track_id'].nunique()} tracks, {len(table)} rows{every}")
    all_axes[-1].set_xlabel("time in s")
    figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
