"""Data of the page's map and timeline: vehicles as columns of numbers, rounded to screen resolution."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from analysis.metrics import unsignalled
from analysis.plots.drive import JUMP_M, STEP_GAP_S, episodes
from analysis.report.reading import RunTables, json_ready
from sumo_net.arrays import Array

MOST_ROWS = 40_000  # of steps on the page; larger runs show only the vehicles with most events
PATH_EVERY = 5  # steps between points of a path on the map
MOST_PATH_POINTS = 40_000
_COLUMNS = {  # name on the page: (column, decimals)
    "offset": ("true_lateral_offset_m", 3),
    "camera": ("lateral_offset_m", 3),
    "width": ("width", 2),
    "tlc": ("true_tlc_s", 2),
    "foreseen": ("tlc_s", 2),
    "ttc": ("true_ttc_s", 2),
    "radar": ("fcw_ttc_s", 2),
    "speed": ("speed_mps", 1),
}
_SHOWN_TTC_S = 10.0


def scene(run: RunTables, lines: Sequence[Array]) -> dict[str, Any] | None:
    """Data of map and timeline; None if no equipped vehicle drove. Adds a note if vehicles are left out."""
    steps = run["steps"]
    if steps.empty:
        return None
    steps = steps.assign(width=steps["true_lane_width_m"].fillna(steps["lane_width_m"]))
    for column in ("true_ttc_s", "fcw_ttc_s"):  # larger ones are not drawn and only add to the page's size
        steps[column] = steps[column].where(steps[column] <= _SHOWN_TTC_S)
    names = _by_events(run)
    rows_of = dict(tuple(steps.groupby("vehicle_id", observed=True)))
    shown: list[str] = []
    total = 0
    for name in names:
        total += len(rows_of[name])
        if total > MOST_ROWS and shown:
            break
        shown.append(name)
    if len(shown) < len(names):
        run.notes.append(
            f"The timeline offers the {len(shown)} of {len(names)} equipped vehicles with most events, "
            "so that the page stays small"
        )
    return {
        "vehicles": [_vehicle(name, rows_of[name], run) for name in shown],
        "paths": _paths(steps),
        "outline": _joined(lines),
        "events": _events(run),
    }


def _by_events(run: RunTables) -> list[str]:
    """Vehicle ids by number of departures and warnings, descending."""
    steps, departures, warnings = run["steps"], run["departures"], run["warnings"]
    meant = unsignalled(departures)
    count = steps["vehicle_id"].value_counts().sort_index() * 1e-6
    for events, weight in ((meant, 3), (warnings[warnings["kind"] == "ldw"], 2), (warnings, 1)):
        count = count.add(weight * events["vehicle_id"].value_counts(), fill_value=0.0)
    count = count[count.index.isin(steps["vehicle_id"])]
    return [str(name) for name in count.sort_values(ascending=False, kind="stable").index]


def _vehicle(name: str, rows: pd.DataFrame, run: RunTables) -> dict[str, Any]:
    rows = rows.sort_values("time_s")
    columns: dict[str, Any] = {"time": _numbers(rows["time_s"], 1)}
    for key, (column, decimals) in _COLUMNS.items():
        columns[key] = _numbers(rows[column], decimals)
    gap = rows["time_s"].diff() > STEP_GAP_S
    for column in ("true_lateral_offset_m", "lateral_offset_m"):
        gap |= rows[column].diff().abs() > JUMP_M
    warnings = run["warnings"][run["warnings"]["vehicle_id"] == name]
    departures = run["departures"][run["departures"]["vehicle_id"] == name]
    last = float(rows["time_s"].iloc[-1])
    return {
        "id": name,
        "columns": columns,
        "breaks": np.flatnonzero(gap.to_numpy()).tolist(),
        "episodes": [list(one) for one in episodes(rows)],
        "warnings": json_ready(
            warnings.assign(end_s=warnings["end_s"].fillna(last))[
                ["kind", "level", "side", "outcome", "start_s", "end_s"]
            ].values.tolist()
        ),
        "departures": json_ready(departures[["side", "crossing_s", "cause", "warned"]].values.tolist()),
    }


def _paths(steps: pd.DataFrame) -> list[dict[str, Any]]:
    """One polyline per vehicle, broken where rows are missing."""
    known = steps[steps["true_x_m"].notna() & steps["true_y_m"].notna()]
    every = max(PATH_EVERY, -(-len(known) // MOST_PATH_POINTS))
    paths = []
    for name, rows in known.groupby("vehicle_id", observed=True):
        ordered = rows.sort_values("time_s")
        new = (ordered["time_s"].diff() > STEP_GAP_S).cumsum()
        x: list[float | None] = []
        y: list[float | None] = []
        for _, part in ordered.groupby(new):
            chosen = part.iloc[np.unique(np.r_[np.arange(0, len(part), every), len(part) - 1])]
            x += [*_numbers(chosen["true_x_m"], 1), None]
            y += [*_numbers(chosen["true_y_m"], 1), None]
        paths.append({"id": str(name), "x": x, "y": y})
    return paths


def _events(run: RunTables) -> list[dict[str, Any]]:
    """Departures and warnings with their positions."""
    departures, warnings = run["departures"], run["warnings"]
    meant = unsignalled(departures)
    found = []
    for kind, table, when, about in (
        ("fcw", warnings[warnings["kind"] == "fcw"], "start_s", ("level", "outcome")),
        ("ldw", warnings[warnings["kind"] == "ldw"], "start_s", ("side", "outcome")),
        ("departure", meant, "crossing_s", ("side", "cause")),
    ):
        place = table.dropna(subset=["true_x_m", "true_y_m"])
        found.append(
            {
                "kind": kind,
                "x": _numbers(place["true_x_m"], 1),
                "y": _numbers(place["true_y_m"], 1),
                "time": _numbers(place[when], 1),
                "vehicle": place["vehicle_id"].astype(str).tolist(),
                "text": [
                    ", ".join(str(value).replace("_", " ") for value in row if value is not None)
                    for row in place[list(about)].astype(object).values.tolist()
                ],
                "missing": len(table) - len(place),
            }
        )
    return found


def _joined(lines: Sequence[Array]) -> dict[str, Any]:
    """Many lines as one, with gaps between them."""
    x: list[float | None] = []
    y: list[float | None] = []
    for line in lines:
        x += [*np.round(line[:, 0], 1).tolist(), None]
        y += [*np.round(line[:, 1], 1).tolist(), None]
    return {"x": x, "y": y}


def _numbers(values: "pd.Series[Any]", decimals: int) -> list[float | None]:
    """Rounded numbers, None where unknown."""
    rounded = np.round(values.to_numpy(np.float64, na_value=np.nan), decimals)
    return [None if value != value else value for value in rounded.tolist()]
