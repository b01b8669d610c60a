"""The radar chain of a fleet: detections, tracks, and the rear-end warning."""

import dataclasses
from typing import NamedTuple

import numpy as np

from camera_synth.camera import projection
from ego_synth.sensors import Readings
from plugin import ranging_kernels as kernels
from plugin.configuration import Configuration
from plugin.lane.hidden import Bodies
from plugin.motion.estimate import MotionEstimate
from plugin.tracking.closing import ClosingFilter, ClosingState
from plugin.tracking.detections import Detections, EgoMotion, sensor_motion
from plugin.tracking.rear_view import NOBODY, RearView, Watched, watch
from plugin.tracking.tracker import Tracker, TrackerSettings, TrackerState, TrackList
from plugin.warning import collision
from plugin.warning.collision import CollisionState, CollisionWarning, InPath
from radar_synth.radar import OwnMotion, ScanTruth, Sightings
from radar_synth.scan import flatten, scan
from radar_synth.visibility import objects_in_view
from sumo_net.arrays import Array
from sumo_net.batch import join
from sumo_net.ego import EgoTruth
from sumo_net.randomness import stream_key
from sumo_net.road import RoadNetwork
from sumo_net.roadside import place
from sumo_net.snapshot import Snapshot
from sumo_net.step import STEP_S
from sumo_net.surroundings import Objects

_MOVING_MPS = 5.0  # a track without a class yet is taken for a vehicle above this speed


class RangingState(NamedTuple):
    """State of n vehicles' radars and warnings between scans, (n, …) each."""

    radar_key: Array  # uint64
    scan: Array  # int64, number of the scan
    collision: CollisionState


class Tracked(NamedTuple):
    """State of the fleet's tracks between scans."""

    tracker: TrackerState
    leaders: ClosingState


class Echo(NamedTuple):
    """Results of one scan of n vehicles."""

    tracks: TrackList  # T tracks of the fleet, x and y from the centre of gravity
    in_path: InPath  # (T,)
    warning: CollisionWarning  # (n,)
    track_ttc_s: Array  # (n,) to the warning's target by its track alone
    watched: Watched  # the rear of the nearest body in path in the next frame, (n,)
    objects: Objects  # truth from here on: bodies that reach into the field of view, (n, M)
    seen: Sightings  # (n, M)
    behind: ScanTruth  # (n, D)
    place: tuple[Array, Array]  # row and column in `behind` of each detection given to the tracker


class Ranging:
    """The radar chain with its settings; `step` once per 0.1 s."""

    def __init__(self, configuration: Configuration, seed: int, roads: RoadNetwork) -> None:
        self._seed = seed
        self._radar = configuration.radar
        self._tracker = Tracker(mounted(configuration.tracker, configuration.radar.mount_forward_m))
        self._mount_m = configuration.radar.mount_forward_m
        self._projection = projection(configuration.camera)
        self._closing = ClosingFilter(
            configuration.following, configuration.tracker.filters.noise, self._mount_m, self._projection
        )
        self._collision = collision.on_vehicle(configuration.collision, configuration.vehicle)
        self._roadside = place(
            configuration.roadside, roads.graph, roads.shoulder_right_m, roads.shoulder_left_m
        )

    def init(self, vehicle_ids: list[str]) -> RangingState:
        """State of vehicles before their first scan."""
        keys = [stream_key(self._seed, name, "radar") for name in vehicle_ids]
        n = len(keys)
        return RangingState(np.array(keys, np.uint64), np.zeros(n, np.int64), collision.init(n))

    def no_tracks(self, n: int) -> Tracked:
        """n vehicles without tracks."""
        return Tracked(self._tracker.init(n), self._closing.init())

    def reindex(self, tracked: Tracked, rows: Array) -> Tracked:
        """Tracks for a changed fleet: its vehicle i is the old row rows[i], or a new one where that is -1."""
        return Tracked(
            self._tracker.reindex(tracked.tracker, rows), self._closing.reindex(tracked.leaders, rows)
        )

    def join(self, *tracked: Tracked) -> Tracked:
        """Tracks of several fleets as one, their vehicles in the order given."""
        before, leaders = 0, []
        for part in tracked:
            leaders.append(part.leaders._replace(owner=part.leaders.owner + before))
            before += len(part.tracker.next_id)
        return Tracked(self._tracker.join(*(part.tracker for part in tracked)), join(*leaders))

    def step(
        self,
        state: RangingState,
        tracked: Tracked,
        truth: EgoTruth,
        snapshot: Snapshot,
        motion: MotionEstimate,
        readings: Readings,
        rear: RearView,
    ) -> tuple[RangingState, Tracked, Echo]:
        """Scan, track and warn, for n > 0 vehicles.

        `motion` is the observer's estimate, `readings` are those of the vehicle's own sensors, `rear` is what
        the camera saw of the body watched. The truth is for the radar synthesiser alone.
        """
        objects = objects_in_view(self._radar, truth, snapshot, self._roadside)
        own = OwnMotion(truth.speed_mps, truth.lateral_speed_mps, truth.yaw_rate_rps)
        reported, behind, seen = scan(self._radar, objects, own, state.radar_key, state.scan)
        flat = flatten(reported)
        detections = Detections(
            flat.owner,
            flat.range_m,
            flat.range_rate_mps,
            flat.azimuth_rad,
            np.full(len(flat.owner), -1, np.int64),
        )
        # the vehicle's own sensors measure all but v_y, which the observer estimates
        ego = EgoMotion(
            readings.speed_mps,
            readings.acceleration_mps2,
            readings.yaw_rate_rps,
            np.where(np.isnan(motion.lateral_speed_mps), 0.0, motion.lateral_speed_mps),
        )
        tracker, tracks = self._tracker.step(tracked.tracker, detections, ego, STEP_S)
        leaders, followed = tracked.leaders, tracks
        if self._closing.options.enabled:
            leaders, followed = self._closing.step(
                leaders, tracks, detections, sensor_motion(ego, self._mount_m), rear, state.collision.inside,
                STEP_S,
            )  # fmt: skip
        targets = collision.targets_from(followed, tracker.tracks.unseen_s, rear.track_id)
        warned, warning, in_path = collision.step(
            state.collision,
            targets,
            motion,
            readings.speed_mps,
            readings.acceleration_mps2,
            readings.yaw_rate_rps,
            self._collision,
        )
        after = RangingState(state.radar_key, state.scan + 1, warned)
        place = flat.owner, flat.column
        alone = collision.time_by_tracks(tracks, warning.row, ego.speed_mps, self._collision)
        watched = self._next_rears(followed, warning.nearest, ego, rear)
        return (
            after,
            Tracked(tracker, leaders),
            Echo(tracks, in_path, warning, alone, watched, objects, seen, behind, place),
        )

    def _next_rears(self, tracks: TrackList, nearest: Array, ego: EgoMotion, rear: RearView) -> Watched:
        """The rears of the tracks `nearest` (n,), -1 for none, at their places in the next frame."""
        x, y, next_x, next_y = kernels.rears(
            tracks.estimate, nearest, ego.speed_mps, ego.yaw_rate_rps, STEP_S
        )
        turn = ego.yaw_rate_rps * STEP_S
        track_id = np.append(tracks.track_id, NOBODY)[nearest]
        return watch(track_id, (x, y), (next_x, next_y), rear, turn, self._projection)


def bodies_ahead(tracks: TrackList, unseen_s: Array, speed_mps: Array, yaw_rate_rps: Array) -> Bodies:
    """The vehicles among the tracks at their places in the next step, for the camera.

    Bodies that were never seen moving are left out: posts and rails beside the road hide none of it.
    """
    found = kernels.bodies(tracks, unseen_s, speed_mps, yaw_rate_rps, STEP_S, collision.LATEST_S, _MOVING_MPS)
    return Bodies(*found)


def mounted(tracker: TrackerSettings, forward_m: float) -> TrackerSettings:
    """The tracker of a radar that sits `forward_m` ahead of the centre of gravity."""
    return dataclasses.replace(
        tracker, filters=dataclasses.replace(tracker.filters, mount_forward_m=forward_m)
    )
