"""The kernels of a run, in parts that can be compiled independently.

The arguments have the types of a run, but their values have no meaning.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np


def lane() -> None:
    """Compile the lane tracker."""
    from camera_synth.camera import Camera, projection, vehicle_from_image
    from camera_synth.render import new_frames
    from plugin.lane import refine
    from plugin.lane.estimate import BORDER_Y

    p = projection(Camera())
    vehicle_from_image(p.center_x, 1.0, p)
    state, _ = refine.step(new_frames(1), None, None, refine.init(1), p, np.zeros(1), refine.Refine())
    refine.parabolas(state, refine.border_columns(state, BORDER_Y, p), BORDER_Y)


def picture() -> None:
    """Compile the renderer, the true borders, and the recognition verdict."""
    from camera_synth.camera import PROCESSED_FROM, Camera, projection
    from camera_synth.render import new_frames, render
    from camera_synth.truth import border_columns, new_border_columns
    from plugin.lane.estimate import ROWS
    from plugin.recognition_kernels import judge
    from sumo_net.road import OWN_RIGHT

    p, (road, none, pose, looks) = projection(Camera()), _scene()
    keys, start, own = np.zeros(1, np.uint64), np.zeros(1, np.int64), np.array([OWN_RIGHT])
    render(
        new_frames(1), p, road, none, pose, looks, keys, start, PROCESSED_FROM, (own, new_border_columns(1))
    )
    truth = border_columns(p, road, none, own, looks, pose)
    judge(truth.column, truth.painted, np.zeros((1, 2, ROWS)), 0.0, 0.0, np.zeros(1, np.int8))


def search() -> None:
    """Compile the published search."""
    from camera_synth.camera import Camera
    from camera_synth.render import new_frames
    from plugin.lane import genetic

    numbers = genetic.search_numbers(genetic.fitted_to(genetic.GeneticSearch(), Camera()))
    genetic.search(new_frames(1), genetic.init(np.zeros(1, np.uint64)), numbers)


def _scene() -> tuple[Any, ...]:
    # one camera in an empty scene: road, objects, pose, looks
    from camera_synth.condition import Condition, looks
    from camera_synth.pose import Pose
    from sumo_net.road import AHEAD_M, MAX_BORDERS, RoadAhead
    from sumo_net.surroundings import MAX_OBJECTS, Objects

    nowhere = np.full((1, len(AHEAD_M)), np.nan)
    lines = np.full((1, len(AHEAD_M), MAX_BORDERS), np.nan)
    road = RoadAhead(*(nowhere,) * 5, lines, np.zeros(lines.shape, np.int8), nowhere, nowhere)
    none = Objects(np.full((1, MAX_OBJECTS), -1), *(np.full((1, MAX_OBJECTS), np.nan),) * 7)
    return road, none, Pose(*(np.zeros(1),) * 3), looks(Condition(), 1)


def motion() -> None:
    """Compile own sensors, observer, prediction, lane-departure warning, scoring, by default settings."""
    from camera_synth.camera import Camera
    from ego_synth import sensors
    from plugin.ground_truth import Judge
    from plugin.lane.estimate import LaneEstimate
    from plugin.motion import observer, prediction
    from plugin.motion.estimate import OwnReadings
    from plugin.warning import departure
    from plugin.warning.tlc import time_to_lane_crossing
    from sumo_net.ego import EgoTruth
    from sumo_net.road import AHEAD_M
    from sumo_net.vehicle import Vehicle

    vehicle, still, no = Vehicle(), np.zeros(1), np.zeros(1, np.bool_)
    sensors.read(sensors.EgoSensors(), sensors.init(sensors.EgoSensors(), 0, ["one"]), *(still,) * 4)
    schedule = observer.schedule(vehicle, Camera().preview_m, observer.ObserverSettings())
    lane = LaneEstimate(no, *(still,) * 8, no, no, still, still, np.zeros(1, np.int8))
    _, known = observer.step(observer.init(1, schedule), schedule, lane, still, OwnReadings(still, still))
    predictor = prediction.predictor(vehicle, prediction.PredictionSettings())
    path = prediction.predict(known, still, predictor)
    crossing = time_to_lane_crossing(known, path, predictor.step_s, vehicle, still)
    numbers = departure.numbers(departure.DepartureSettings())
    departure.step(departure.init(1), crossing, known, (still, still), still, np.zeros(1, np.int8), numbers)
    kinds = {"handle": np.int64, "path": np.int32, "lanes_left": np.int32, "on_marked_road": np.bool_}
    kinds |= dict.fromkeys(("border_kind_right", "border_kind_left", "signal", "cause"), np.int8)
    truth = EgoTruth._make(np.zeros(1, kinds.get(name, np.float64)) for name in EgoTruth._fields)
    judge = Judge(vehicle, Camera().preview_m, predictor)
    judge.reference(truth, np.zeros((1, len(AHEAD_M))), known, still, path, still)


def scans() -> None:
    """Compile the radar."""
    from radar_synth.radar import OwnMotion, Radar
    from radar_synth.scan import flatten, scan
    from radar_synth.visibility import objects_in_view
    from sumo_net.surroundings import Objects

    at = _snapshot(1)
    objects_in_view(Radar(), at, at)
    one = np.zeros((1, 1))
    body = Objects(np.zeros((1, 1), np.int64), *(one + value for value in (30.0, 0, 0, 9, 4, 2, 1.5)))
    still, keys = np.zeros(1), np.zeros(1, np.uint64)
    reported, _, _ = scan(Radar(), body, OwnMotion(still, still, still), keys, np.zeros(1, np.int64))
    flatten(reported)


def tracks() -> None:
    """Compile the tracker of the default settings."""
    from plugin.tracking.detections import Detections, at_rest
    from plugin.tracking.tracker import Tracker, TrackerSettings

    tracker, first, still = Tracker(TrackerSettings()), np.zeros(1, np.int64), np.zeros(1)
    seen = Detections(first, still + 30.0, still, still, first - 1)
    state = tracker.init(1)
    for _ in range(3):
        state, _ = tracker.step(state, seen, at_rest(1), 0.1)


def leaders() -> None:
    """Compile the following of leaders and the rear-end warning of the default settings."""
    from camera_synth.camera import Camera, projection
    from camera_synth.render import new_frames
    from plugin.lane.hidden import hidden_by
    from plugin.motion.estimate import MotionEstimate
    from plugin.ranging import bodies_ahead
    from plugin.ranging_kernels import rears
    from plugin.tracking import rear_view
    from plugin.tracking.closing import Closing, ClosingFilter
    from plugin.tracking.detections import Detections, at_rest, sensor_motion
    from plugin.tracking.models import RadarNoise
    from plugin.warning import collision

    p, still, no, nobody = projection(Camera()), np.zeros(1), np.zeros(0), np.zeros(0, np.int64)
    found, row = _no_tracks(), np.full(1, -1)
    seen = rear_view.look(new_frames(1), rear_view.nobody_watched(1), p)
    warned = collision.init(1)
    closing = ClosingFilter(Closing(), RadarNoise(), 0.0, p)
    none = Detections(nobody, no, no, no, nobody)
    sensor = sensor_motion(at_rest(1), 0.0)
    _, better = closing.step(closing.init(), found, none, sensor, seen, warned.inside, 0.1)
    targets, options = collision.targets_from(better, no, seen.track_id), collision.Collision()
    known = MotionEstimate(*(still,) * 10, np.zeros(1, np.int8))
    collision.step(warned, targets, known, still, still, still, options)
    collision.time_by_tracks(found, row, still, options)
    rears(found.estimate, row, still, still, 0.1)
    rear_view.watch(np.zeros(1, np.int64), (still, still), (still, still), seen, still, p)
    hidden_by(bodies_ahead(found, no, still, still), 1, p, 0.0)


def scores() -> None:
    """Compile the scoring of radar tracks and warnings, and the rounding of tables."""
    from plugin import track_truth_kernels
    from plugin.conflicts import ConflictBook
    from plugin.events import NOWHERE
    from plugin.leaders import in_view, nobody
    from plugin.record_kernels import rounded
    from plugin.track_truth import Followed
    from radar_synth.radar import ScanTruth
    from sumo_net.surroundings import Objects

    one, still, none = np.zeros(1, np.int64), np.zeros(1), np.zeros((1, 1))
    objects = Objects(np.zeros((1, 1), np.int64), *(none,) * 7)
    behind = ScanTruth(np.zeros((1, 1), np.int64), np.zeros((1, 1), np.int8), *(none,) * 5)
    tracks, no = _no_tracks(), np.zeros(0, np.int64)
    before = Followed(no, no, no.astype(np.int8))
    _, target, _, shown, floats = track_truth_kernels.follow(
        one, tracks, (no, no), behind, objects, before, still, 0.0, 0.0
    )
    track_truth_kernels.rows(one, tracks, tracks.confirmed, target, shown, floats, tracks.confirmed)
    seen = in_view(objects, none, one)
    who = nobody(1), nobody(1), nobody(1)
    ConflictBook().add(0.0, one, *who, seen, still, np.zeros(1, np.int8), still, lambda i: NOWHERE)
    rounded(still, 1.0)


def _no_tracks() -> Any:
    from plugin.tracking.detections import Estimate
    from plugin.tracking.tracker import TrackList

    no = np.zeros(0, np.int64)
    return TrackList(no, no, no, no != 0, no, no.astype(np.int8), no, Estimate(*(np.zeros(0),) * 10))


def own_drive() -> None:
    """Compile the equipped vehicles' drivers and dynamics, and the road that they see."""
    from plugin.leaders import overlapped, path_leaders, warned_of
    from sumo_net.bend_speed_kernels import bend_speeds
    from sumo_net.driver import Driver, attentive, numbers, traits
    from sumo_net.ego import Ego, standing
    from sumo_net.ego_road_kernels import onto_paths
    from sumo_net.randomness import uniform, uniforms
    from sumo_net.road_store import RoadStore
    from sumo_net.surroundings import MAX_OBJECTS, Objects
    from sumo_net.vehicle import Vehicle, model

    table, no, vehicle = RoadStore().table, np.zeros(0), Vehicle()
    traffic = SimpleNamespace(lane_ids=[], accelerations_mps2=lambda _: no)
    fleet = Ego(SimpleNamespace(table=table), traffic, 0)
    truth = fleet.step(_snapshot(0), no != 0)
    drawn = traits(Driver(), vehicle, 0, [], no)
    onto_paths(
        standing(np.zeros(0, np.int64)), attentive(drawn), drawn, table, np.zeros(0, np.int64),
        np.zeros(0, np.int32), no, no, vehicle.bumper_m, numbers(Driver(), vehicle), model(vehicle),
    )  # fmt: skip
    bodies = Objects(np.zeros((0, MAX_OBJECTS), np.int64), *(np.zeros((0, MAX_OBJECTS)),) * 7)
    path_leaders(truth, bodies, table, vehicle.bumper_m)
    warned_of(truth, bodies, table, truth.handle, vehicle.bumper_m, 0.0, 0.0)
    overlapped(bodies, truth.handle)
    bend_speeds(table, truth.path, no, no, 0.0, 0.0)
    uniform(np.uint64(0), 0)
    uniforms(np.zeros(0, np.uint64), 0)


def surroundings() -> None:
    """Compile the road ahead, the surrounding bodies and the leaders of equipped vehicles."""
    from plugin.leaders import LaneOrder
    from sumo_net.frames import heading_from_sumo_angle
    from sumo_net.road_kernels import ahead
    from sumo_net.road_store import RoadStore
    from sumo_net.surroundings import objects_around

    no, one, at = np.zeros(0), np.zeros(1, np.int64), _snapshot(1)
    heading_from_sumo_angle(no)
    ahead(RoadStore().table, np.zeros(0, np.int32), no, no, no)
    pose: Any = SimpleNamespace(handle=one, x_m=at.x_m, y_m=at.y_m, heading_rad=at.heading_rad)
    objects_around(pose, at)
    graph: Any = SimpleNamespace(lanes={})
    LaneOrder(graph, ["lane"], lambda _: ()).leaders(at, one)


def _snapshot(n: int) -> Any:
    from sumo_net.snapshot import Snapshot

    at = Snapshot(np.zeros(n, np.int64), *(np.zeros(n),) * 9)
    return at._replace(lane=np.zeros(n, np.int32))


# The longest first, so that neither process waits long for the other's last. Kernels that call the same large
# inner kernels are in one part, since inner kernels are not cached for the other process.
PARTS = (lane, picture, motion, own_drive, leaders, tracks, scans, search, scores, surroundings)
