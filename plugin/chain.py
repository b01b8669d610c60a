"""The processing in n equipped vehicles each 0.1 s: sense -> estimate -> predict -> warn; its columns.

Vehicles' chains are independent: any part of a fleet can be processed by itself, with the same results. The
truth is used only by the synthesisers and for the columns that score the estimates.
"""

from typing import Any, NamedTuple

from camera_synth.pose import Pose
from ego_synth.sensors import SensorState
from plugin import step_columns
from plugin.configuration import Configuration
from plugin.ground_truth import Judge
from plugin.lane.detector import LaneDetector
from plugin.motion import observer, prediction
from plugin.motion.estimate import Trajectory
from plugin.own_motion import OwnSensors
from plugin.ranging import Echo, Ranging, RangingState, Tracked, bodies_ahead
from plugin.vision import Scene, Sight, Vision, VisionState
from plugin.warning import departure
from plugin.warning.tlc import time_to_lane_crossing
from sumo_net.arrays import Array
from sumo_net.batch import join, select
from sumo_net.ego import EgoTruth
from sumo_net.road import RoadNetwork
from sumo_net.road_kernels import ahead as road_ahead
from sumo_net.snapshot import Snapshot
from sumo_net.surroundings import objects_around


class VehicleState(NamedTuple):
    """State of n vehicles between steps, without their tracks; (n, …) each."""

    handle: Array  # int64
    own: SensorState
    vision: VisionState
    observer: observer.State
    departure: departure.DepartureState
    ranging: RangingState


class ChainState(NamedTuple):
    """State of the assistance of n vehicles between steps."""

    vehicles: VehicleState
    tracked: Tracked  # of all n vehicles


class Moment(NamedTuple):
    """One step of n vehicles, before their rows are made."""

    handle: Array  # (n,)
    vision: VisionState  # that the frames of this step were drawn with
    scene: Scene
    sight: Sight
    after: VisionState
    path: Trajectory  # predicted


class Outcome(NamedTuple):
    """Results of one step of n vehicles."""

    truth: EgoTruth
    warning: departure.DepartureWarning
    echo: Echo
    columns: step_columns.Columns  # of the table `steps`, without time and radar scores
    moment: Moment


class Chain:
    """The chain with its settings; `step` once per 0.1 s. Holds no state of vehicles."""

    def __init__(
        self,
        configuration: Configuration,
        seed: int,
        roads: RoadNetwork,
        beside: bool,
        detector: LaneDetector[Any] | None = None,
    ) -> None:
        """`beside`: the published search also runs on every frame, for comparison. `detector`: see Vision."""
        self._vehicle = configuration.vehicle
        preview_m = configuration.camera.preview_m
        self._roads = roads
        self._own = OwnSensors(configuration, seed)
        self.vision = Vision(configuration, seed, beside, detector)
        self._observing = observer.schedule(self._vehicle, preview_m, configuration.observing)
        self._predicting = prediction.predictor(self._vehicle, configuration.predicting)
        self._judge = Judge(self._vehicle, preview_m, self._predicting)
        self._warning = departure.numbers(configuration.departure)
        self._ranging = Ranging(configuration, seed, roads)

    def init(self, handle: Array, names: list[str]) -> ChainState:
        """n vehicles before their first step: their handles (n,) and ids."""
        n = len(handle)
        vehicles = VehicleState(
            handle,
            self._own.init(names),
            self.vision.init(names),
            observer.init(n, self._observing),
            departure.init(n),
            self._ranging.init(names),
        )
        return ChainState(vehicles, self._ranging.no_tracks(n))

    def select(self, state: ChainState, rows: Array) -> ChainState:
        """The state of the vehicles in `rows` (k,)."""
        return ChainState(select(state.vehicles, rows), self._ranging.reindex(state.tracked, rows))

    def join(self, *states: ChainState) -> ChainState:
        """The states of several groups of vehicles, concatenated."""
        vehicles, tracked = zip(*states, strict=True)
        return ChainState(join(*vehicles), self._ranging.join(*tracked))

    def step(
        self, state: ChainState, truth: EgoTruth, half_span_m: Array, snapshot: Snapshot
    ) -> tuple[ChainState, Outcome]:
        """One step of n > 0 vehicles in a snapshot of all the traffic; half_span_m (n,) as of Ego."""
        before = state.vehicles
        ahead = road_ahead(
            self._roads.table, truth.path, truth.station_m, truth.path_offset_m, truth.path_heading_rad
        )
        pose = Pose(truth.x_m, truth.y_m, truth.heading_rad)
        objects = objects_around(truth, snapshot)
        scene = Scene(ahead, objects, pose, truth.lanes_left, truth.lane_offset_m, truth.lane_width_m)
        sensors, own = self._own.step(before.own, truth)
        speed = own.readings.speed_mps
        turning = self._own.turning(own, before.observer)
        vision, sight = self.vision.step(before.vision, scene, speed, turning)
        observing, motion = observer.step(before.observer, self._observing, sight.lane, speed, own.observed)
        path = prediction.predict(motion, speed, self._predicting)
        crossing = time_to_lane_crossing(motion, path, self._predicting.step_s, self._vehicle, half_span_m)
        unseen_m = sight.lane.left_unseen_m, sight.lane.right_unseen_m
        warning_state, warning = departure.step(
            before.departure, crossing, motion, unseen_m, speed, truth.signal, self._warning
        )
        readings = self._own.for_radar(own, observing, motion)
        ranging, tracked, echo = self._ranging.step(
            before.ranging, state.tracked, truth, snapshot, motion, readings, sight.rear
        )
        unseen_s = tracked.tracker.tracks.unseen_s
        bodies = bodies_ahead(echo.tracks, unseen_s, speed, readings.yaw_rate_rps)
        vision = self.vision.with_bodies(vision, bodies, echo.watched)
        reference = self._judge.reference(truth, ahead.curvature_1pm, motion, speed, path, half_span_m)
        columns = step_columns.of_truth(truth, snapshot) | step_columns.of_sight(sight)
        columns |= step_columns.of_motion(motion) | step_columns.of_warning(crossing, warning)
        columns |= step_columns.of_reference(reference)
        vehicles = VehicleState(truth.handle, sensors, vision, observing, warning_state, ranging)
        moment = Moment(truth.handle, before.vision, scene, sight, vision, path)
        return ChainState(vehicles, tracked), Outcome(truth, warning, echo, columns, moment)
