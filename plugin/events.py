"""Departures and warnings as events, and their matching (ISO 17361's placement zone, from memory)."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pydantic import Field

from plugin.schema import TABLES
from sumo_net.driver import CAUSES
from sumo_net.driver_kernels import SIGNALLED_CHANGE
from sumo_net.settings import settings

LEFT, RIGHT = 1, -1
SIDE_NAMES = {LEFT: "left", RIGHT: "right"}


@settings
class Matching:
    """When a warning and a crossing belong together, and for which crossings a warning is due."""

    early_s: float = Field(
        3.0, gt=0, description="a warning is true if a crossing follows its start within this time, or …"
    )
    after_end_s: float = Field(0.5, ge=0, description="… its end within this time")
    late_s: float = Field(1.0, ge=0, description="a warning may begin this long after the crossing")
    drift_mps: float = Field(0.05, gt=0, description="true lateral speed that counts as a drift")
    drift_window_s: float = Field(
        0.5, gt=0, description="a drift is looked for this long before and after the warning's start"
    )
    rearm_margin_m: float = Field(
        0.1, ge=0, description="a border counts again once the wheel was this far inside …"
    )
    rearm_s: float = Field(2.0, ge=0, description="… or after this time")
    signalled_s: float = Field(
        1.5,
        ge=0,
        description="a crossing is a signalled change if the turn signal to its side was on within this time "
        "before, also if the change was then aborted",
    )
    due_from_mps: float = Field(11.1, ge=0, description="a warning is due for crossings from this speed on")


class Place(NamedTuple):
    """Where a vehicle is, as columns of the tables of events."""

    lane_id: str
    true_x_m: float
    true_y_m: float


NOWHERE = Place("", math.nan, math.nan)


@dataclass(slots=True)
class Departure:
    """One true crossing of a border by a front wheel's outer edge."""

    handle: int
    side: int
    crossing_s: float
    cause: int
    lateral_speed_mps: float
    speed_mps: float
    place: Place = NOWHERE


@dataclass(slots=True)
class LaneWarning:
    """One lane-departure warning; `end_s` is None while it lasts."""

    handle: int
    side: int
    start_s: float
    tlc_s: float
    margin_m: float
    drift_mps: float = 0.0
    end_s: float | None = None
    place: Place = NOWHERE


def in_placement_zone(margin_m: float, drift_mps: float) -> bool:
    """Whether a warning that begins `margin_m` inside the border is neither too early nor too late.

    ISO 17361 from memory: the earliest line lies 0.75 m inside up to 0.5 m/s, 1.5 s times the drift rate
    up to 1 m/s, 1.5 m above; the latest 0.3 m outside (passenger cars).
    """
    earliest = min(max(1.5 * drift_mps, 0.75), 1.5)
    return -0.3 <= margin_m <= earliest


@dataclass(slots=True)
class EventBook:
    """Events that wait until all that could match them has been seen."""

    matching: Matching
    departures: list[Departure] = field(default_factory=list)
    warnings: list[LaneWarning] = field(default_factory=list)
    _archive: list[Departure | LaneWarning] = field(default_factory=list)  # matched lately

    def settle(self, until_s: float, final: bool) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
        """Rows (departures, warnings) of all events that can be matched by `until_s`; the rest is kept."""
        by_vehicle: dict[tuple[int, int], list[LaneWarning]] = defaultdict(list)
        for warning in self.warnings:
            by_vehicle[warning.handle, warning.side].append(warning)
        crossings: dict[tuple[int, int], list[Departure]] = defaultdict(list)
        for departure in self.departures:
            crossings[departure.handle, departure.side].append(departure)

        done = [d for d in self.departures if final or d.crossing_s + self.matching.late_s <= until_s]
        departure_rows = [self._departure_row(d, by_vehicle[d.handle, d.side]) for d in done]
        ended = [w for w in self.warnings if final or self._decided(w, until_s)]
        warning_rows = [self._warning_row(w, crossings[w.handle, w.side]) for w in ended]

        keep_from = until_s - 60.0
        finished = {id(event) for event in (*done, *ended)}
        self._archive = [e for e in (*self._archive, *done, *ended) if _time(e) > keep_from]
        self.departures = [d for d in self.departures if id(d) not in finished]
        self.warnings = [w for w in self.warnings if id(w) not in finished]
        return departure_rows, warning_rows

    def _decided(self, warning: LaneWarning, until_s: float) -> bool:
        return warning.end_s is not None and self._last_match(warning) <= until_s

    def _last_match(self, warning: LaneWarning) -> float:
        end = float("inf") if warning.end_s is None else warning.end_s
        return max(warning.start_s + self.matching.early_s, end + self.matching.after_end_s)

    def _belong(self, warning: LaneWarning, departure: Departure) -> bool:
        first = warning.start_s - self.matching.late_s
        return first <= departure.crossing_s <= self._last_match(warning)

    def _departure_row(self, departure: Departure, warnings: Iterable[LaneWarning]) -> dict[str, object]:
        candidates = [*warnings, *self._archived(LaneWarning, departure.handle, departure.side)]
        matches = [w for w in candidates if self._belong(w, departure)]
        first = min(matches, key=lambda w: w.start_s, default=None)
        lead = None if first is None else departure.crossing_s - first.start_s
        due = departure.cause != SIGNALLED_CHANGE and departure.speed_mps >= self.matching.due_from_mps
        return {
            "handle": departure.handle,
            "side": SIDE_NAMES[departure.side],
            "crossing_s": departure.crossing_s,
            "cause": CAUSES[departure.cause],
            "lateral_speed_mps": departure.lateral_speed_mps,
            "speed_mps": departure.speed_mps,
            "warned": lead is not None and lead >= 0.0 if due else None,
            "lead_time_s": lead,
            "in_zone": None if first is None else in_placement_zone(first.margin_m, first.drift_mps),
            **departure.place._asdict(),
        }

    def _warning_row(self, warning: LaneWarning, departures: Iterable[Departure]) -> dict[str, object]:
        candidates = [*departures, *self._archived(Departure, warning.handle, warning.side)]
        matches = [d.crossing_s for d in candidates if self._belong(warning, d)]
        if matches:
            outcome = "true"
        else:
            outcome = "nuisance" if warning.drift_mps > self.matching.drift_mps else "false"
        return {
            "handle": warning.handle,
            "kind": "ldw",
            "level": "warning",
            "side": SIDE_NAMES[warning.side],
            "start_s": warning.start_s,
            "end_s": warning.end_s,
            "tlc_s": warning.tlc_s,
            "lead_time_s": min(matches) - warning.start_s if matches else None,
            "outcome": outcome,
            **warning.place._asdict(),
        }

    def _archived(self, kind: type, handle: int, side: int) -> list[Any]:
        return [e for e in self._archive if type(e) is kind and e.handle == handle and e.side == side]


def event_columns(
    table: str, rows: Sequence[Mapping[str, Any]], name: Callable[[int], str]
) -> dict[str, list[Any]]:
    """Events, with the keys `handle` and perhaps `target`, as columns of `table` by time and vehicle.

    name: the ids of vehicles by handle.
    """
    when = "crossing_s" if table == "departures" else "start_s"
    rows = sorted(rows, key=lambda row: (row[when], name(row["handle"])))
    known = rows[0].keys()
    columns = {one.name: [row[one.name] for row in rows] for one in TABLES[table] if one.name in known}
    columns["vehicle_id"] = [name(row["handle"]) for row in rows]
    if "target" in known:
        columns["target_id"] = [name(row["target"]) for row in rows]
    return columns


def _time(event: Departure | LaneWarning) -> float:
    return event.crossing_s if isinstance(event, Departure) else event.start_s
