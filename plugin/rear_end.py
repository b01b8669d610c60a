"""Rear-end warnings and radar tracks against truth."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plugin.configuration import Configuration
from plugin.conflicts import ConflictBook, LaneOrder, Leaders, in_view, path_leaders, table_columns
from plugin.ranging import Echo
from plugin.record import Recorder
from plugin.schema import TABLES
from plugin.track_truth import TrackTruth
from plugin.warning.collision import BUZZER, CODES
from sumo_net.batch import join
from sumo_net.ego import EgoTruth
from sumo_net.road import RoadNetwork
from sumo_net.snapshot import Snapshot
from sumo_net.traffic import Traffic

Array = np.ndarray[Any, Any]

LABELS = {"fcw_state": CODES, "fcw_buzzer": BUZZER}


class RearEndScorer:
    """Scores what the radar chain made of each step and hands the rows to the recorder."""

    def __init__(
        self, recorder: Recorder, traffic: Traffic, roads: RoadNetwork, configuration: Configuration
    ) -> None:
        self._recorder, self._traffic, self._roads = recorder, traffic, roads
        self._bumper_m = configuration.vehicle.bumper_m
        self._overlap_m = configuration.conflicts.overlap_m
        self._reach_m = configuration.conflicts.reach_m
        self._order = LaneOrder(roads.graph, traffic.lane_ids, traffic.route_ahead)
        self._book = ConflictBook(configuration.conflicts)
        self._tracks = TrackTruth(configuration.tracker.classes, traffic.vehicle_id)
        self._pending: list[dict[str, Array]] = []  # rows of `tracks`
        self._recording = configuration.recording
        self._scans = 0
        self._latest: tuple[dict[str, Array], Array] = {}, np.zeros(0, bool)  # tracks of the last step, shown
        self.conflicts = 0
        self.warnings = 0  # of the reminder level

    def add(
        self, snapshot: Snapshot, truth: EgoTruth, parts: Sequence[tuple[EgoTruth, Echo]]
    ) -> dict[str, Array]:
        """Take one step of n vehicles, echoes in parts; its columns of `steps`, with codes for LABELS."""
        time, warning = self._traffic.time_s, join(*(echo.warning for _, echo in parts))
        leader = self._order.leaders(snapshot, truth.handle, self._reach_m)
        by_place, visible = self._by_place(parts, leader)
        self._book.add(
            time, truth.handle, leader, by_place, visible, truth.speed_mps, warning.level, warning.ttc_s
        )
        tracks = self._tracks.step(parts)
        shown = np.concatenate([echo.tracks.confirmed for _, echo in parts])
        self._latest = tracks, shown
        if self._recording.tracks:
            if self._scans % self._recording.roadside_every:
                shown = shown & (tracks["target"] >= 0)
            kept = np.flatnonzero(shown)
            rows = {name: part[kept] for name, part in tracks.items()}
            self._pending.append(rows | {"time_s": np.full(len(rows["handle"]), time)})
        self._scans += 1
        return {
            "fcw_state": warning.code,
            "fcw_track_id": warning.track_id,
            "fcw_gap_m": warning.gap_m,
            "fcw_relative_speed_mps": warning.relative_mps,
            "fcw_ttc_s": warning.ttc_s,
            "fcw_reminder_m": warning.reminder_m,
            "fcw_danger_m": warning.danger_m,
            "fcw_lamp_reminder": warning.lamp_reminder,
            "fcw_lamp_danger": warning.lamp_danger,
            "fcw_buzzer": warning.buzzer,
            "fcw_shown_distance_m": warning.shown_distance_m,
            "fcw_shown_relative_speed_mps": warning.shown_relative_mps,
            "true_gap_m": leader.gap_m,
            "true_ttc_s": leader.ttc_s,
            "true_leader_visible": visible,
            "fcw_track_ttc_s": np.concatenate([echo.track_ttc_s for _, echo in parts]),
        }

    def _by_place(self, parts: Sequence[tuple[EgoTruth, Echo]], leader: Leaders) -> tuple[Leaders, Array]:
        """The leaders by where they are, and whether SUMO has the same and the radar could see them.

        A neighbour that the vehicle turns towards is not yet in its path.
        """
        table, found, seen = self._roads.table, [], []
        begin = 0
        for truth, echo in parts:
            target = leader.handle[begin : begin + len(truth.handle)]
            begin += len(target)
            found.append(path_leaders(truth, echo.objects, table, self._bumper_m, self._overlap_m))
            seen.append(in_view(echo.objects, echo.seen.share, target))
        by_place = join(*found)
        return by_place, np.concatenate(seen) & (by_place.handle == leader.handle)

    def latest_of(self, handle: int) -> dict[str, Array]:
        """All confirmed tracks of a vehicle after the last step, also those that are not recorded."""
        tracks, shown = self._latest
        own = (tracks["handle"] == handle) & shown
        return {name: part[own] for name, part in tracks.items()}

    def track_rows(self, tracks: dict[str, Array]) -> dict[str, Any]:
        """Such tracks as the table `tracks` has them."""
        return self._tracks.texts(tracks)

    def settle(self, until_s: float, final: bool = False) -> None:
        """Write the tracks so far, and the conflicts and warnings that are decided by `until_s`."""
        if self._pending:
            steps, self._pending = self._pending, []
            columns = {name: np.concatenate([step[name] for step in steps]) for name in steps[0]}
            self._recorder.append("tracks", self._tracks.texts(columns))
        conflicts, warnings = self._book.settle(until_s, final)
        self.conflicts += len(conflicts)
        self.warnings += sum(row["level"] == "reminder" for row in warnings)
        for table, rows in (("conflicts", conflicts), ("warnings", warnings)):
            if rows:
                events = table_columns(rows, self._traffic.vehicle_id, TABLES[table])
                self._recorder.append(table, events)
