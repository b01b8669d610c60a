"""Rear-end warnings and radar tracks against truth."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plugin.configuration import Configuration
from plugin.conflicts import ConflictBook, LaneOrder, Leaders, in_view, path_leaders, table_columns
from plugin.ranging import Echo
from plugin.record import Recorder
from plugin.schema import TABLES
from plugin.track_truth import Rows, Step, TrackTruth
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
        self._pending: list[tuple[float, Rows]] = []  # of `tracks`, and when
        self._recording = configuration.recording
        self._scans = 0
        self._latest: tuple[float, list[Step]] = np.nan, []
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
        steps = self._tracks.step(parts)
        self._latest = time, steps
        if self._recording.tracks:
            everything = self._scans % self._recording.roadside_every == 0
            for step in steps:
                shown = step.tracks.confirmed
                self._pending.append((time, step.of(shown if everything else shown & (step.target >= 0))))
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

    def latest_of(self, handle: int) -> dict[str, Any]:
        """Rows of `tracks` of a vehicle in the last step, also of tracks that are not recorded."""
        time, steps = self._latest
        step = next(one for one in steps if handle in one.handle)
        own = (step.handle[step.tracks.owner] == handle) & step.tracks.confirmed
        return self._tracks.table([time], [step.of(own)])

    def settle(self, until_s: float, final: bool = False) -> None:
        """Write the tracks so far, and the conflicts and warnings that are decided by `until_s`."""
        if self._pending:
            times, steps = zip(*self._pending, strict=True)
            self._pending = []
            self._recorder.append("tracks", self._tracks.table(times, steps))
        conflicts, warnings = self._book.settle(until_s, final)
        self.conflicts += len(conflicts)
        self.warnings += sum(row["level"] == "reminder" for row in warnings)
        for table, rows in (("conflicts", conflicts), ("warnings", warnings)):
            if rows:
                events = table_columns(rows, self._traffic.vehicle_id, TABLES[table])
                self._recorder.append(table, events)
