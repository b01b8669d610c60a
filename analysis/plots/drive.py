"""Figures of places and times: the map of a run, the timeline of one vehicle."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.drive import unknown_vehicle
from analysis.metrics import unsignalled
from analysis.plots.style import BLACK, BLUE, GREY, ORANGE, PURPLE, SKY, VERMILLION, nothing, sheet, styled

STEP_GAP_S = 0.15  # rows further apart are not consecutive
JUMP_M = 1.0  # a larger change of the offset in a step means that its reference lane changed
EPISODES = {
    "distraction": ("distraction", ORANGE, "//"),
    "microsleep": ("microsleep", PURPLE, "xx"),
    "lane_change_signalled": ("lane change", "#d9d9d9", ""),
    "lane_change_unsignalled": ("lane change without signal", "#b3b3b3", ".."),
}


def with_gaps(steps: pd.DataFrame, columns: Sequence[str]) -> pd.DataFrame:
    """One vehicle's rows, with an empty row where rows are missing or the lane changes, to break lines."""
    rows = steps[["time_s", *columns]].astype("float64").sort_values("time_s")
    broken = rows["time_s"].diff() > STEP_GAP_S
    for column in {"true_lateral_offset_m", "lateral_offset_m"} & set(columns):
        broken |= rows[column].diff().abs() > JUMP_M
    after = rows.loc[broken, ["time_s"]] - 0.05
    return pd.concat([rows, after]).sort_values("time_s", ignore_index=True)


@styled
def road_map(
    steps: pd.DataFrame,
    departures: pd.DataFrame,
    warnings: pd.DataFrame,
    outline: Sequence[Any] = (),
) -> Figure:
    """Paths of the equipped vehicles, departures and warnings. `outline`: (N, 2) arrays, such as lanes."""
    known = steps[steps["true_x_m"].notna() & steps["true_y_m"].notna()]
    long = not known.empty and _spread(known) > 3.0
    figure, axes = sheet(1, 1, 2.9 if long else 4.6, width_in=7.0 if long else 5.0)
    if known.empty:
        nothing(axes, "the table steps has no positions")
        return figure
    for line in outline:
        axes.plot(line[:, 0], line[:, 1], color="#c9c9c9", linewidth=1.0)
    for _, rows in known.groupby(["run_id", "vehicle_id"], observed=True):
        path = with_gaps(rows, ["true_x_m", "true_y_m"])
        axes.plot(path["true_x_m"], path["true_y_m"], color=SKY, linewidth=0.9, alpha=0.8)
    meant = unsignalled(departures)
    ldw, fcw = (warnings[warnings["kind"] == kind] for kind in ("ldw", "fcw"))
    for events, colour, marker, label in (
        (fcw, ORANGE, "^", "rear-end warning"),
        (ldw, BLUE, "o", "lane-departure warning"),
        (meant, VERMILLION, "X", "departure"),
    ):
        place = events.dropna(subset=["true_x_m", "true_y_m"])
        axes.scatter(
            place["true_x_m"],
            place["true_y_m"],
            s=34,
            color=colour,
            marker=marker,
            edgecolors="white",
            linewidths=0.6,
            zorder=3,
            label=f"{label} ({len(place)})",
        )
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x in m", ylabel="y in m")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.3 if long else -0.14), ncols=2)
    return figure


@styled
def timeline(
    steps: pd.DataFrame, departures: pd.DataFrame, warnings: pd.DataFrame, vehicle_id: str | None = None
) -> Figure:
    """One vehicle over time: offset between the borders, times to crossing and collision, warnings, episodes.

    `vehicle_id`: by default the one with the most events. Raises ValueError for an unknown one.
    """
    vehicle_id = vehicle_id or busiest(steps, departures, warnings)
    rows = steps[steps["vehicle_id"] == vehicle_id].sort_values("time_s")
    figure, (offset, tlc, ttc) = sheet(3, 1, 5.6, width_in=7.0, sharex=True, height_ratios=(3, 2, 2))
    if rows.empty:
        if len(steps):
            raise ValueError(unknown_vehicle(vehicle_id, steps["vehicle_id"].astype(str).unique().tolist()))
        nothing(offset, "no equipped vehicle drove")
        return figure
    _offset(offset, rows)
    _times(tlc, rows, "true_tlc_s", "tlc_s", "time to\ncrossing in s", 3.0)
    _times(ttc, rows, "true_ttc_s", "fcw_ttc_s", "time to\ncollision in s", 8.0)
    mine = warnings[warnings["vehicle_id"] == vehicle_id]
    for axes, kind in ((offset, "ldw"), (tlc, "ldw"), (ttc, "fcw")):
        for number, warning in enumerate(mine[mine["kind"] == kind].to_dict("records")):
            end = float(warning["end_s"] if pd.notna(warning["end_s"]) else rows["time_s"].iloc[-1])
            label = "warning" if number == 0 else None
            axes.axvspan(warning["start_s"], end + 0.05, color=VERMILLION, alpha=0.25, lw=0, label=label)
    crossed = departures[departures["vehicle_id"] == vehicle_id]
    border = 0.5 * float(rows["true_lane_width_m"].fillna(rows["lane_width_m"]).median())
    height = np.where(crossed["side"] == "left", border, -border)
    offset.plot(crossed["crossing_s"], height, "X", color=BLACK, markersize=7, label="crosses a border")
    offset.set_title(f"vehicle {vehicle_id}")
    ttc.set_xlabel("SUMO time in s")
    for axes in (offset, tlc, ttc):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _spread(steps: pd.DataFrame) -> float:
    """Aspect ratio, at least 1, of the area that the positions cover."""
    x, y = (float(np.ptp(steps[name])) + 1.0 for name in ("true_x_m", "true_y_m"))
    return max(x / y, y / x)


def busiest(steps: pd.DataFrame, departures: pd.DataFrame, warnings: pd.DataFrame) -> str:
    """The vehicle with most departures and warnings, among equals the longest drive; '' for none."""
    if steps.empty:
        return ""
    meant = unsignalled(departures)["vehicle_id"]
    lane = warnings.loc[warnings["kind"] == "ldw", "vehicle_id"]
    table = pd.DataFrame({"rows": steps["vehicle_id"].value_counts()}).assign(events=0.0)
    for ids, weight in ((meant, 3.0), (lane, 2.0), (warnings["vehicle_id"], 1.0)):
        table["events"] += weight * ids.value_counts().reindex(table.index).fillna(0.0)
    table = table.sort_index().sort_values(["events", "rows"], ascending=False, kind="stable")
    return str(table.index[0])


def episodes(rows: pd.DataFrame) -> list[tuple[str, float, float]]:
    """(cause, from, to) of the driver's actions other than lane keeping; rows of one vehicle by time."""
    cause = rows["true_cause"].fillna("")
    new = (cause != cause.shift()) | (rows["time_s"].diff() > STEP_GAP_S)
    spells = rows.assign(cause=cause).groupby(new.cumsum())
    table = spells.agg(cause=("cause", "first"), begin=("time_s", "first"), end=("time_s", "last"))
    kept = table[table["cause"].isin(list(EPISODES))]
    return [(str(r.cause), float(r.begin), float(r.end)) for r in kept.itertuples()]  # type: ignore[arg-type]


def _offset(axes: Axes, rows: pd.DataFrame) -> None:
    named: set[str] = set()
    for cause, begin, end in episodes(rows):
        label, colour, hatch = EPISODES[cause]
        axes.axvspan(
            begin,
            end + 0.1,
            facecolor=colour,
            alpha=0.45,
            hatch=hatch,
            lw=0,
            label=None if label in named else label,
        )
        named.add(label)
    width = rows["true_lane_width_m"].fillna(rows["lane_width_m"])
    lines = with_gaps(
        rows.assign(border=0.5 * width), ["border", "true_lateral_offset_m", "lateral_offset_m"]
    )
    axes.plot(lines["time_s"], lines["border"], color=BLACK, linewidth=1.2, label="lane borders")
    axes.plot(lines["time_s"], -lines["border"], color=BLACK, linewidth=1.2)
    axes.plot(lines["time_s"], lines["true_lateral_offset_m"], color=SKY, linewidth=3.2, label="true offset")
    axes.plot(
        lines["time_s"],
        lines["lateral_offset_m"],
        color=VERMILLION,
        linestyle="--",
        linewidth=1.1,
        label="camera",
    )
    axes.set(ylabel="left of lane\ncentre in m", ylim=(-2.6, 2.6))


def _times(axes: Axes, rows: pd.DataFrame, truth: str, estimate: str, label: str, top_s: float) -> None:
    lines = with_gaps(rows, [truth, estimate])
    axes.plot(lines["time_s"], lines[truth], color=SKY, linewidth=3.2, label="true")
    axes.plot(lines["time_s"], lines[estimate], color=VERMILLION, linestyle="--", label="estimated")
    axes.set(ylabel=label, ylim=(0.0, top_s))
    if rows[truth].isna().all() and rows[estimate].isna().all():
        axes.text(0.5, 0.5, "none", color=GREY, ha="center", transform=axes.transAxes)
