"""Other warning thresholds without simulating again, from the stored times to crossing or collision.

A warning begins when the time falls to the threshold, having been near it one step before, and ends
`hysteresis_s` above it, as in the run. The other rules of the run's warning (placement zone, one warning for
each approach) are left out, so that only the threshold is compared. True events are matched as in the run.
"""

import itertools
from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd

from analysis.campaign.store import Store
from analysis.metrics import SIGNALLED, distance_km
from analysis.rear_end import VISIBLE_S
from analysis.statistics import per_100_km
from plugin.conflicts import ConflictSettings
from plugin.events import SIDE_NAMES, Departure, EventBook, LaneWarning, Matching
from plugin.warning.collision import Collision
from plugin.warning.departure import DepartureSettings
from sumo_net.driver import CAUSES
from sumo_net.settings import SettingsError
from sumo_net.step import STEP_S

NEEDED = {"ldw": ("steps", "departures"), "fcw": ("steps", "conflicts")}
_LDW, _LDW_EVENTS, _FCW, _FCW_EVENTS = DepartureSettings(), Matching(), Collision(), ConflictSettings()
_APPROACH_TTC_S = 10.0  # below this true time to collision, a warning without a conflict is a nuisance
_SIDES = {name: side for side, name in SIDE_NAMES.items()}


def thresholds(text: str) -> list[float]:
    """FROM:TO:STEP, both ends included. Raises SettingsError."""
    try:
        first, last, step = (float(part) for part in text.split(":"))
    except ValueError:
        raise SettingsError(f"--threshold {text}: must be FROM:TO:STEP, as in 0.2:2.0:0.05") from None
    if not (0.0 < first <= last and step > 0.0 and (last - first) / step < 1000):
        raise SettingsError(f"--threshold {text}: must rise from above 0 in at most 1000 steps")
    return [round(first + k * step, 6) for k in range(int((last - first) / step + 1e-9) + 1)]


def sweep(out: str, kind: str, values: Iterable[float]) -> pd.DataFrame:
    """The ROC table of a campaign that kept `steps`, a row per threshold; also written to sweep_KIND.csv."""
    store, values = Store(out), list(values)
    total = np.zeros((len(values), 4), np.int64)  # events, hits, false, nuisance
    leads: list[list[float]] = [[] for _ in values]
    km, runs = 0.0, 0
    for key in sorted(store.done()):
        steps, events = (store.table(key, name) for name in NEEDED[kind])
        if steps is None or events is None:
            raise SettingsError(f"{out}: run {key} has no table steps: run the campaign with --keep steps")
        km += distance_km(steps)
        runs += 1
        judge = _judge_lane if kind == "ldw" else _judge_collision
        for k, value in enumerate(values):
            counts, lead = judge(steps, events, value)
            total[k] += counts
            leads[k] += lead
    if not runs:
        raise SettingsError(f"{out}: contains no run")
    table = pd.DataFrame(
        {
            "threshold_s": values,
            "events": total[:, 0],
            "hits": total[:, 1],
            "misses": total[:, 0] - total[:, 1],
            "hit_rate": np.where(total[:, 0] > 0, total[:, 1] / np.maximum(total[:, 0], 1), np.nan),
            "false": total[:, 2],
            "nuisance": total[:, 3],
            "false_per_100km": [per_100_km(int(n), km) for n in total[:, 2]],
            "nuisance_per_100km": [per_100_km(int(n), km) for n in total[:, 3]],
            "median_lead_s": [float(np.median(lead)) if lead else float("nan") for lead in leads],
        }
    )
    store.write_text(f"sweep_{kind}.csv", table.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    return table


def _spells(time: pd.Series, value: pd.Series, threshold: float) -> Iterator[tuple[int, int]]:
    """(first, last) row of each warning of one vehicle with consecutive rows."""
    breaks = np.diff(time.to_numpy(), prepend=-np.inf) > 0.15
    near = (value <= threshold + _LDW.confirm_s).to_numpy()
    low = (value <= threshold).to_numpy() & np.r_[False, near[:-1]] & ~breaks
    high = (value <= threshold + _LDW.hysteresis_s).to_numpy()
    start = -1
    for i in range(len(low)):
        if start >= 0 and (breaks[i] or not high[i]):
            yield start, i - 1
            start = -1
        if start < 0 and low[i]:
            start = i
    if start >= 0:
        yield start, len(low) - 1


def _judge_lane(
    steps: pd.DataFrame, departures: pd.DataFrame, threshold: float
) -> tuple[list[int], list[float]]:
    book, number = EventBook(_LDW_EVENTS), itertools.count()
    handles: dict[str, int] = {}
    window = round(_LDW_EVENTS.drift_window_s / STEP_S)
    drift = steps["speed_mps"] * np.sin(steps["true_heading_error_rad"])
    drift += steps["true_lateral_speed_mps"] * np.cos(steps["true_heading_error_rad"])
    usable = (steps["speed_mps"] >= _LDW.least_speed_mps) & (steps["true_cause"] != SIGNALLED)
    for vehicle, rows in steps.assign(drift=drift, usable=usable).groupby("vehicle_id", observed=True):
        handle = handles.setdefault(str(vehicle), next(number))
        for name, side in _SIDES.items():
            value = rows["tlc_s"].where((rows["tlc_side"] == name) & rows["usable"])
            for first, last in _spells(rows["time_s"], value, threshold):
                near = slice(max(first - window, 0), first + window + 1)
                book.warnings.append(
                    LaneWarning(
                        handle,
                        side,
                        float(rows["time_s"].iloc[first]),
                        float(value.iloc[first]),
                        margin_m=float("nan"),
                        drift_mps=float((side * rows["drift"].iloc[near]).max()),
                        end_s=float(rows["time_s"].iloc[last]),
                    )
                )
    for row in departures.itertuples():
        handle = handles.setdefault(str(row.vehicle_id), next(number))
        cause = CAUSES.index(str(row.cause))
        book.departures.append(
            Departure(
                handle,
                _SIDES[str(row.side)],
                float(row.crossing_s),  # type: ignore[arg-type]
                cause,
                lateral_speed_mps=0.0,
                speed_mps=float(row.speed_mps),  # type: ignore[arg-type]
            )
        )
    crossings, warnings = book.settle(float("inf"), True)
    meant = [row for row in crossings if row["warned"] is not None]
    hits = [float(row["lead_time_s"]) for row in meant if row["warned"]]  # type: ignore[arg-type]
    outcomes = [row["outcome"] for row in warnings]
    return [len(meant), len(hits), outcomes.count("false"), outcomes.count("nuisance")], hits


def _judge_collision(
    steps: pd.DataFrame, conflicts: pd.DataFrame, threshold: float
) -> tuple[list[int], list[float]]:
    counts, leads = [0, 0, 0, 0], []
    decisive = conflicts["critical_s"].fillna(conflicts["end_s"])
    due = conflicts.assign(decisive=decisive)[conflicts["visible_s"] >= VISIBLE_S]
    counts[0] = len(due)
    usable = steps["speed_mps"] >= _FCW.least_speed_mps
    early_s, after_s, late_s = _FCW_EVENTS.early_s, _FCW_EVENTS.after_end_s, _FCW_EVENTS.late_s
    for vehicle, rows in steps.assign(usable=usable).groupby("vehicle_id", observed=True):
        time, value = rows["time_s"], rows["fcw_ttc_s"].where(rows["usable"])
        spells = [(float(time.iloc[a]), float(time.iloc[b]), a) for a, b in _spells(time, value, threshold)]
        mine = conflicts[conflicts["vehicle_id"] == vehicle]
        for start, end, a in spells:
            reach = max(start + early_s, end + after_s)
            if not ((mine["start_s"] <= reach) & (mine["end_s"] >= start - late_s)).any():
                near = rows["true_ttc_s"].iloc[a] < _APPROACH_TTC_S
                counts[3 if near else 2] += 1
        for moment in due.loc[due["vehicle_id"] == vehicle, "decisive"]:
            before = [s for s, e, _ in spells if s <= moment <= max(s + early_s, e + after_s)]
            if before:
                counts[1] += 1
                leads.append(float(moment) - max(before))
    return counts, leads
