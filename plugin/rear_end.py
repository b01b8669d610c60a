"""Rear-end warnings and radar tracks scored against truth."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from plugin.configuration import Configuration
from plugin.conflicts import ConflictBook
from plugin.events import Place, event_columns
from plugin.leaders import NOBODY, LaneOrder, Leaders, in_view, overlapped, path_leaders, warned_of
from plugin.ranging import Echo
from plugin.record import Recorder
from plugin.track_truth import Followed, Rows, Step, TrackTruth, table
from plugin.warning.collision import BUZZER, CODES
from sumo_net.arrays import Array
from sumo_net.batch import join
from sumo_net.ego import EgoTruth
from sumo_net.road import RoadNetwork
from sumo_net.snapshot import Snapshot
from sumo_net.traffic import Traffic

LABELS = {"fcw_state": CODES, "fcw_buzzer": BUZZER}


class Judged(NamedTuple):
    """The truth of one scan of a part of the fleet, n vehicles."""

    by_place: Leaders  # leaders by position, not by SUMO's lane
    warned_of: Leaders  # the bodies that drivers are warned of, nobody for those that are not in the way
    visible: Array  # (n,) bool: the leader on SUMO's lane is the same, and in the radar's view
    overlapped: Array  # (n,) bool: another body overlaps that leader's
    followed: Followed
    tracks: Step
    rows: Rows | None  # of `tracks`, if that is recorded


class RearEndScorer:
    """Scores the radar chain's results of each step and hands the rows to the recorder."""

    def __init__(
        self, recorder: Recorder, traffic: Traffic, roads: RoadNetwork, configuration: Configuration
    ) -> None:
        self._recorder, self._traffic, self._roads = recorder, traffic, roads
        self._bumper_m = configuration.vehicle.bumper_m
        self._overlap_m = configuration.conflicts.overlap_m
        self._entering_s = configuration.conflicts.entering_s
        self._reach_m = configuration.conflicts.reach_m
        self._order = LaneOrder(roads.graph, traffic.lane_ids, traffic.route_ahead)
        self._book = ConflictBook(configuration.conflicts)
        self._tracks = TrackTruth(configuration.tracker.classes)
        self._pending: list[tuple[float, Rows]] = []  # time and rows of `tracks`
        self._recording = configuration.recording
        self._scans = 0
        self._latest: tuple[float, list[Step]] = np.nan, []
        self.conflicts = 0
        self.warnings = 0  # of the reminder level

    def leaders(self, snapshot: Snapshot, handle: Array) -> Leaders:
        """The leaders of n vehicles on SUMO's lanes."""
        return self._order.leaders(snapshot, handle, self._reach_m)

    def judge(self, truth: EgoTruth, echo: Echo, leader: Array) -> Judged:
        """The truth for a part of the fleet, with the handles (n,) of its leaders on SUMO's lanes.

        Parts may be judged concurrently. A neighbour that the vehicle turns towards is not yet in its path.
        """
        ahead = truth, echo.objects, self._roads.table
        by_place = path_leaders(*ahead, self._bumper_m, self._overlap_m)
        visible = in_view(echo.objects, echo.seen.share, leader) & (by_place.handle == leader)
        shared = overlapped(echo.objects, leader)
        followed, tracks = self._tracks.follow(truth, echo)
        row = np.where(echo.warning.level > 0, echo.warning.row, -1)
        target = np.append(tracks.target, NOBODY)[row]
        warned = warned_of(*ahead, target, self._bumper_m, self._overlap_m, self._entering_s)
        if not self._recording.tracks:
            return Judged(by_place, warned, visible, shared, followed, tracks, None)
        everything = self._scans % self._recording.roadside_every == 0
        shown = tracks.tracks.confirmed & (everything | (tracks.target >= 0))
        shown[echo.warning.row[echo.warning.row >= 0]] = True
        return Judged(by_place, warned, visible, shared, followed, tracks, tracks.of(shown))

    def add(
        self, truth: EgoTruth, lane: Array, leader: Leaders, parts: Sequence[tuple[Echo, Judged]]
    ) -> dict[str, Array]:
        """Take one step of n vehicles, part by part; its columns of `steps`, with codes for LABELS.

        lane : (n,) int, SUMO's.
        """

        def place(i: int) -> Place:
            return Place(self._traffic.lane_ids[int(lane[i])], float(truth.x_m[i]), float(truth.y_m[i]))

        echoes, judged = zip(*parts, strict=True)
        time, warning = self._traffic.time_s, join(*(echo.warning for echo in echoes))
        by_place = join(*(one.by_place for one in judged))
        target = join(*(one.warned_of for one in judged))
        visible = np.concatenate([one.visible for one in judged])
        speed, level, ttc_s = truth.speed_mps, warning.level, warning.ttc_s
        self._book.add(time, truth.handle, leader, by_place, target, visible, speed, level, ttc_s, place)
        self._tracks.keep(one.followed for one in judged)
        self._latest = time, [one.tracks for one in judged]
        self._pending += [(time, one.rows) for one in judged if one.rows is not None]
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
            "fcw_track_ttc_s": np.concatenate([echo.track_ttc_s for echo in echoes]),
            "true_leader_overlapped": np.concatenate([one.overlapped for one in judged]),
        }

    def latest_of(self, handle: int) -> dict[str, Any]:
        """Rows of `tracks` of a vehicle in the last step, also of tracks that are not recorded."""
        time, steps = self._latest
        step = next(one for one in steps if handle in one.handle)
        own = (step.handle[step.tracks.owner] == handle) & step.tracks.confirmed
        return table([time], [step.of(own)], self._traffic.names)

    def write_tracks(self, fewest: int = 1) -> None:
        """Hand the tracks so far, if `fewest` or more, to the recorder, which may write them later."""
        if self._pending and sum(rows.codes.shape[1] for _, rows in self._pending) >= fewest:
            times, steps = zip(*self._pending, strict=True)
            self._pending, names = [], dict(self._traffic.names)
            self._recorder.later(lambda: self._recorder.append("tracks", table(times, steps, names)))

    def settle(self, until_s: float, final: bool = False) -> None:
        """Write the tracks so far, and the conflicts and warnings that can be matched by `until_s`."""
        self.write_tracks()
        conflicts, warnings = self._book.settle(until_s, final)
        self.conflicts += len(conflicts)
        self.warnings += sum(row["level"] == "reminder" for row in warnings)
        for name, rows in (("conflicts", conflicts), ("warnings", warnings)):
            if rows:
                self._recorder.append(name, event_columns(name, rows, self._traffic.vehicle_id))
