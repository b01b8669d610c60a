"""Scoring against the path actually driven: true time to lane crossing, prediction errors, events.

A step is scored against its future, so steps wait in a buffer until the look-ahead has been driven. `settle`
then turns them into rows, for all vehicles at once.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa

from plugin.events import LEFT, RIGHT, Departure, EventBook, LaneWarning, Matching, Place, event_columns
from plugin.record import Recorder
from plugin.schema import TABLES
from sumo_net.arrays import Array
from sumo_net.driver import CAUSES
from sumo_net.driver_kernels import LANE_KEEPING, SIGNALLED_CHANGE
from sumo_net.step import STEP_S

Names = Mapping[int, str]  # ids of vehicles by handle

HORIZONS_S = (0.5, 1.0, 1.5, 2.0)
STRADDLING_M = 0.4  # this near to a border, either of its lanes counts as the own lane
LOOK_AHEAD_S = 5.0  # the true time to lane crossing is empty beyond this
_HORIZON_STEPS = np.rint(np.array(HORIZONS_S) / STEP_S).astype(np.int64)
_JUMP_M = 1.0  # a larger change of the lane offset in one step means that its reference lane changed
_STEP_COLUMNS = tuple(column.name for column in TABLES["steps"])
_MOVED_M = 1.5  # a vehicle this far from where it would have driven to was moved
PREDICTORS = ("predicted", "constant_velocity", "constant_radius", "true_state")


class Scorer:
    """Buffers the steps of a run, scores them against their future and hands the rows to the recorder.

    `add` takes one step of n vehicles as columns: those of the table `steps` known so far, and

    handle, step : int64, vehicle and number of the step
    x_m, y_m, world_heading_rad : true pose of the centre of gravity
    margin_left_m, margin_right_m : from the front wheels' outer edges to the painted borders, positive
        inside; NaN where no marking is painted
    drift_mps : true lateral speed in the lane, left positive
    cause : index into CAUSES
    signal : turn signal, +1 left, -1 right, 0 none
    warning_side : +1, -1, 0 of the lane-departure warning
    predicted, constant_velocity, constant_radius, true_state : (n, 4, 3) forward, left, heading in the
        vehicle frame at HORIZONS_S; NaN where nothing was predicted
    """

    def __init__(
        self,
        recorder: Recorder,
        names: Names,
        labels: Mapping[str, Sequence[str]] | None = None,
        matching: Matching | None = None,
    ) -> None:
        """`names`: the vehicles' ids by handle. `labels`: texts for the codes of columns, -1 for none."""
        self._recorder = recorder
        self._names = names
        self._labels = labels or {}
        self._book = EventBook(matching or Matching())
        self._steps: list[dict[str, Array]] = []
        self._context: dict[str, Array] | None = None
        self._last_crossing: dict[tuple[int, int], int] = {}
        self._open: dict[int, LaneWarning] = {}
        self.distance_m = 0.0
        self.vehicle_steps = 0
        self.departures = 0  # without a turn signal
        self.warnings = 0

    def add(self, columns: dict[str, Array]) -> None:
        """Take one step; arrays of equal length n."""
        if len(columns["handle"]):
            self._steps.append(columns)
            self.vehicle_steps += len(columns["handle"])
            speed = columns["speed_mps"]
            self.distance_m += float(np.where(np.isnan(speed), 0.0, speed).sum()) * STEP_S

    def now(self, columns: dict[str, Array]) -> dict[str, Any]:
        """Columns of `steps` as far as they are known in the step itself: without true TLC."""
        return self._step_columns(columns, slice(None), self._names)

    def settle(self, now_s: float, final: bool = False) -> None:
        """Write all rows whose future is known by `now_s`; with `final`, all that are left.

        The recorder may do it later, in its own thread.
        """
        steps, self._steps = self._steps, []
        until = np.inf if final else now_s - LOOK_AHEAD_S
        self._recorder.later(partial(self._settle, steps, dict(self._names), until, final))

    def _settle(self, steps: list[dict[str, Array]], names: Names, until: float, final: bool) -> None:
        rows = self._gather(steps)
        if rows is None:
            return
        new = ~rows["written"] & (rows["time_s"] <= until)
        follows = _follows(rows)
        self._book.departures += self._departures(rows, follows, new)
        self._warnings(rows, follows, new, until)
        rows["true_tlc_s"] = _true_tlc(rows, follows, _crossings(rows, follows))
        self._write_steps(rows, new, names)
        self._write_predictions(rows, follows, new, names)
        departures, warnings = self._book.settle(until, final)
        self.departures += sum(row["cause"] != CAUSES[SIGNALLED_CHANGE] for row in departures)
        self.warnings += len(warnings)
        for table, events in (("departures", departures), ("warnings", warnings)):
            if events:
                self._recorder.append(table, event_columns(table, events, names.__getitem__))
        rows["written"] |= new
        self._forget_crossings(rows["step"])
        keep = rows["time_s"] > until - 2.0  # context: causes and drifts shortly before an event
        self._context = {name: column[keep] for name, column in rows.items()} if not final else None

    def _gather(self, steps: list[dict[str, Array]]) -> dict[str, Array] | None:
        parts = steps if self._context is None else [self._context, *steps]
        if not parts:
            return None
        names = parts[-1].keys() - {"written", "true_tlc_s"}
        rows = {name: np.concatenate([part[name] for part in parts]) for name in names}
        count = len(rows["handle"])
        rows["written"] = np.zeros(count, dtype=bool)
        if self._context is not None:
            written = self._context["written"]
            rows["written"][: len(written)] = written
        order = np.lexsort((rows["step"], rows["handle"]))
        return {name: column[order] for name, column in rows.items()}

    def _departures(self, rows: dict[str, Array], follows: Array, new: Array) -> list[Departure]:
        """The crossings that count: the wheel was well inside since the last one, or that was long ago."""
        events: list[Departure] = []
        matching = self._book.matching
        index = np.arange(len(follows))
        starts = np.r_[True, rows["handle"][1:] != rows["handle"][:-1]]
        first = np.maximum.accumulate(np.where(starts, index, 0))  # row at which the vehicle's rows begin
        for side, margin in ((LEFT, rows["margin_left_m"]), (RIGHT, rows["margin_right_m"])):
            inside = np.maximum.accumulate(np.where(margin > matching.rearm_margin_m, index, -1))
            for i in _inward_to_outward(margin, rows["true_lateral_offset_m"], follows & new).tolist():
                key = int(rows["handle"][i]), side
                step, last = int(rows["step"][i]), self._last_crossing.get(key)
                self._last_crossing[key] = step
                since = int(rows["step"][inside[i]]) if inside[i] >= first[i] else -1
                if last is None or since > last or (step - last) * STEP_S > matching.rearm_s:
                    events.append(self._departure(rows, follows, i, side, margin))
        return events

    def _forget_crossings(self, steps: Array) -> None:
        """Drop the crossings that can no longer suppress one: those longer ago than `rearm_s`."""
        if len(steps):
            waiting_s = 2.0 * LOOK_AHEAD_S + 10.0  # longer than rows wait to be scored
            first = int(steps.max()) - round((waiting_s + self._book.matching.rearm_s) / STEP_S)
            self._last_crossing = {key: step for key, step in self._last_crossing.items() if step >= first}

    def _departure(
        self, rows: dict[str, Array], follows: Array, i: int, side: int, margin: Array
    ) -> Departure:
        part = margin[i - 1] / (margin[i - 1] - margin[i])
        cause = int(rows["cause"][i])
        back = i
        while (
            cause == LANE_KEEPING and back > 0 and follows[back] and i - back < 20
        ):  # the cause may just have ended
            back -= 1
            cause = int(rows["cause"][back])
        lately = slice(max(i - round(self._book.matching.signalled_s / STEP_S), 0), i + 1)
        if np.any((rows["handle"][lately] == rows["handle"][i]) & (rows["signal"][lately] == side)):
            cause = SIGNALLED_CHANGE
        return Departure(
            handle=int(rows["handle"][i]),
            side=side,
            crossing_s=float(rows["time_s"][i - 1] + STEP_S * part),
            cause=cause,
            lateral_speed_mps=float(side * rows["drift_mps"][i]),
            speed_mps=float(rows["speed_mps"][i]),
            place=self._place(rows, i),
        )

    def _warnings(self, rows: dict[str, Array], follows: Array, new: Array, until: float) -> None:
        side = rows["warning_side"]
        before = np.where(follows, np.roll(side, 1), 0)
        window = round(self._book.matching.drift_window_s / STEP_S)
        for i in np.flatnonzero(new & ((side != before) | (~follows))).tolist():
            handle = int(rows["handle"][i])
            ended = self._open.pop(handle, None)
            if ended is not None:
                ended.end_s = float(rows["time_s"][i]) - STEP_S if follows[i] else ended.start_s
            if side[i] != 0:
                margin = rows["margin_left_m"] if side[i] == LEFT else rows["margin_right_m"]
                near = slice(max(i - window, 0), i + window + 1)
                same = rows["handle"][near] == handle
                drift = np.max(np.where(same, side[i] * rows["drift_mps"][near], -np.inf))
                warning = LaneWarning(
                    handle=handle,
                    side=int(side[i]),
                    start_s=float(rows["time_s"][i]),
                    tlc_s=float(rows["tlc_s"][i]),
                    margin_m=float(margin[i]),
                    drift_mps=float(drift),
                    place=self._place(rows, i),
                )
                self._open[handle] = warning
                self._book.warnings.append(warning)
        last_seen = dict(zip(rows["handle"].tolist(), rows["time_s"].tolist(), strict=True))
        for handle, warning in list(self._open.items()):
            gone = handle not in last_seen or last_seen[handle] < until - 1.0
            if gone:  # the vehicle left during its warning
                warning.end_s = last_seen.get(handle, warning.start_s)
                del self._open[handle]

    def _place(self, rows: dict[str, Array], i: int) -> Place:
        lane = self._labels["lane_id"][int(rows["lane_id"][i])]
        return Place(lane, float(rows["x_m"][i]), float(rows["y_m"][i]))

    def _write_steps(self, rows: dict[str, Array], new: Array, names: Names) -> None:
        self._recorder.append("steps", self._step_columns(rows, _by_time(rows, new), names))

    def _step_columns(self, rows: dict[str, Array], order: slice | Array, names: Names) -> dict[str, Any]:
        """The columns of the table `steps`, with text for codes, of the chosen rows as given to `add`."""
        columns: dict[str, Any] = {name: rows[name][order] for name in _STEP_COLUMNS if name in rows}
        columns["vehicle_id"] = named(rows["handle"][order], names.__getitem__)
        columns["true_cause"] = labelled(rows["cause"][order], CAUSES)
        columns |= {"true_x_m": rows["x_m"][order], "true_y_m": rows["y_m"][order]}
        for name, labels in self._labels.items():
            columns[name] = labelled(columns[name], labels)
        for name in ("recognised", "paper_recognised"):
            if name in columns:
                columns[name] = pa.array(columns[name] == 1, mask=columns[name] < 0)
        if "fcw_track_id" in columns:
            columns["fcw_track_id"] = pa.array(columns["fcw_track_id"], mask=columns["fcw_track_id"] < 0)
        return columns

    def _write_predictions(self, rows: dict[str, Array], follows: Array, new: Array, names: Names) -> None:
        order = _by_time(rows, new)
        drive = _drives(follows)
        later = order[:, None] + _HORIZON_STEPS
        inside = np.minimum(later, len(drive) - 1)
        known = (later < len(drive)) & (drive[inside] == drive[order][:, None])
        known &= np.isfinite(rows["predicted"][order, :, 0])
        cos, sin = (
            np.cos(rows["world_heading_rad"][order])[:, None],
            np.sin(rows["world_heading_rad"][order])[:, None],
        )
        dx, dy = (
            rows["x_m"][inside] - rows["x_m"][order][:, None],
            rows["y_m"][inside] - rows["y_m"][order][:, None],
        )
        forward, left = cos * dx + sin * dy, cos * dy - sin * dx
        turn = rows["world_heading_rad"][inside] - rows["world_heading_rad"][order][:, None]
        errors = {}
        for name in PREDICTORS:
            path = rows[name][order]
            ahead, aside = path[..., 0] - forward, path[..., 1] - left
            errors[name] = (
                np.cos(turn) * aside - np.sin(turn) * ahead,
                np.cos(turn) * ahead + np.sin(turn) * aside,
            )
        keep = np.flatnonzero(known.ravel())
        horizon = np.broadcast_to(np.array(HORIZONS_S), known.shape).ravel()[keep]
        times = np.repeat(rows["time_s"][order], len(HORIZONS_S))[keep]
        handles = np.repeat(rows["handle"][order], len(HORIZONS_S))[keep]
        heading = (rows["predicted"][order][..., 2] - turn).ravel()[keep]
        self._recorder.append(
            "predictions",
            {
                "time_s": times,
                "vehicle_id": named(handles, names.__getitem__),
                "horizon_s": horizon,
                "lateral_error_m": errors["predicted"][0].ravel()[keep],
                "longitudinal_error_m": errors["predicted"][1].ravel()[keep],
                "heading_error_rad": (heading + np.pi) % (2.0 * np.pi) - np.pi,
                "constant_velocity_lateral_error_m": errors["constant_velocity"][0].ravel()[keep],
                "constant_radius_lateral_error_m": errors["constant_radius"][0].ravel()[keep],
                "true_state_lateral_error_m": errors["true_state"][0].ravel()[keep],
            },
        )


def named(handles: Array, name: Callable[[int], str | None]) -> pa.Array:
    """The names of handles (N,), null where there is none."""
    if not len(handles):
        return pa.array([], type=pa.string())
    least = int(handles.min())
    there = np.zeros(int(handles.max()) - least + 1, np.bool_)  # a table, as handles are dense
    there[handles - least] = True
    index = np.cumsum(there, dtype=np.int32) - 1
    names = pa.array([name(one + least) for one in np.flatnonzero(there).tolist()], type=pa.string())
    return pa.DictionaryArray.from_arrays(pa.array(index[handles - least]), names).dictionary_decode()


def labelled(codes: Array, labels: Sequence[str]) -> pa.Array:
    """The labels of codes (n,), null for -1."""
    index = pa.array(codes.astype(np.int32), mask=codes < 0)
    return pa.DictionaryArray.from_arrays(index, pa.array(labels, type=pa.string())).dictionary_decode()


def _follows(rows: dict[str, Array]) -> Array:
    """Whether a row continues the one before it: same vehicle, next step, position reached by driving.

    A vehicle that was moved (by the user, or SUMO's teleport) starts again: nothing is scored across a move.
    """
    follows = np.zeros(len(rows["handle"]), dtype=bool)
    follows[1:] = (np.diff(rows["handle"]) == 0) & (np.diff(rows["step"]) == 1)
    driven = STEP_S * rows["speed_mps"][1:]
    dx = np.diff(rows["x_m"]) - driven * np.cos(rows["world_heading_rad"][1:])
    dy = np.diff(rows["y_m"]) - driven * np.sin(rows["world_heading_rad"][1:])
    follows[1:] &= np.hypot(dx, dy) < _MOVED_M
    return follows


def _drives(follows: Array) -> Array:
    """Number of the drive without a break that each row belongs to."""
    return np.cumsum(~follows)


def _inward_to_outward(margin: Array, offset: Array, follows: Array) -> Array:
    """Rows at which the margin turned from inside to outside of one and the same lane."""
    before = np.roll(margin, 1)
    same_lane = np.abs(offset - np.roll(offset, 1)) < _JUMP_M
    with np.errstate(invalid="ignore"):
        return np.flatnonzero(follows & same_lane & (before > 0.0) & (margin <= 0.0))


def _crossings(rows: dict[str, Array], follows: Array) -> Array:
    """(m, 2): row index just after a crossing, and the crossing's time; sorted by row."""
    found = []
    for margin in (rows["margin_left_m"], rows["margin_right_m"]):
        i = _inward_to_outward(margin, rows["true_lateral_offset_m"], follows)
        part = margin[i - 1] / (margin[i - 1] - margin[i])
        found.append(np.column_stack((i, rows["time_s"][i - 1] + STEP_S * part)))
    merged = np.concatenate(found)
    return merged[np.argsort(merged[:, 0], kind="stable")]


def _true_tlc(rows: dict[str, Array], follows: Array, crossings: Array) -> Array:
    """Time to the next crossing on the same drive, 0 while outside, NaN beyond LOOK_AHEAD_S."""
    time, drive = rows["time_s"], _drives(follows)
    tlc = np.full(len(time), np.nan)
    if len(crossings):
        rank = np.searchsorted(crossings[:, 0], np.arange(len(time)), side="right")
        known = rank < len(crossings)
        nearest = crossings[np.minimum(rank, len(crossings) - 1)]
        same = drive[nearest[:, 0].astype(np.int64)] == drive
        ahead = nearest[:, 1] - time
        tlc = np.where(known & same & (ahead <= LOOK_AHEAD_S) & (ahead >= 0.0), ahead, np.nan)
    with np.errstate(invalid="ignore"):
        outside = (rows["margin_left_m"] <= 0.0) | (rows["margin_right_m"] <= 0.0)
    return np.where(outside, 0.0, tlc)


def _by_time(rows: dict[str, Array], chosen: Array) -> Array:
    """Indices of the chosen rows in the order of the tables: by time, then by vehicle."""
    index = np.flatnonzero(chosen)
    return index[np.lexsort((rows["handle"][index], rows["step"][index]))]
