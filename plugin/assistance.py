"""The 0.1 s step of every equipped vehicle: sense -> estimate -> predict -> warn -> record."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from camera_synth.pose import Pose
from ego_synth.sensors import SensorState
from plugin import capture, rear_end, step_columns
from plugin.capture import Capture, Look, Moment, Watch
from plugin.configuration import Configuration, configuration_from, versions, write_configuration
from plugin.ground_truth import curvature_ahead, margins, true_motion
from plugin.motion import observer, prediction
from plugin.motion.estimate import MotionEstimate, Trajectory
from plugin.own_motion import OwnSensors
from plugin.ranging import Ranging, RangingState, bodies_ahead
from plugin.reaction import Listeners
from plugin.record import Recorder
from plugin.truth import Scorer
from plugin.vision import Scene, Vision, VisionState
from plugin.warning import departure
from plugin.warning.tlc import Crossing, time_to_lane_crossing
from sumo_net.batch import join, select
from sumo_net.bend_speed import BendSpeed
from sumo_net.ego import Ego, EgoTruth
from sumo_net.equipment import EquipmentChoice
from sumo_net.incidents import IncidentMaker
from sumo_net.lane_changes import LaneChanges
from sumo_net.memory import keep_freed_memory
from sumo_net.network import BuiltNetwork
from sumo_net.road import RoadNetwork
from sumo_net.road_kernels import ahead as road_ahead
from sumo_net.script_player import ScriptPlayer
from sumo_net.settings import read_toml
from sumo_net.snapshot import Snapshot
from sumo_net.surroundings import objects_around
from sumo_net.traffic import Traffic

Array = np.ndarray[Any, Any]

SETTLE_EVERY_STEPS = 100  # rows are written every 10 s of simulated time


class FleetState(NamedTuple):
    """What the assistance of n vehicles carries from step to step."""

    handle: Array  # (n,) int64
    own: SensorState
    vision: VisionState
    observer: observer.State
    departure: departure.DepartureState
    ranging: RangingState


class Latest(NamedTuple):
    """The last step of n vehicles, for who watches."""

    handle: Array  # (n,) int64
    departure_code: Array  # (n,) int8, index into plugin.warning.departure.CODES
    collision_code: Array  # (n,) int8, index into plugin.warning.collision.CODES
    moment: Moment
    columns: dict[str, Any]  # those of the table `steps` that are known by then, text as codes


class DriverAssistance:
    """Lane-departure and rear-end warning for the equipped vehicles of a running SUMO simulation.

    Use `attach` in a loop of your own and call `step` after each simulation step; `tables` gives what was
    recorded. Close it, or use it as a context: the last seconds are scored and written then.
    """

    def __init__(
        self,
        traffic: Traffic,
        configuration: Configuration,
        network: BuiltNetwork | Path | None = None,
        *,
        out: Path | None = None,
        formats: Iterable[str] = ("csv",),
        run_id: str = "run",
        seed: int | None = None,
        threads: int | None = None,
        compare_paper: bool = False,
        watch: Watch | None = None,
        scenario: str = "",
    ) -> None:
        """`network`: where the smooth road comes from, by default the network file that SUMO has loaded.

        `watch`: whose camera frames are kept and where; default: those of `recording.frames`, in `out`.
        `scenario`: what the run can be repeated from, for configuration.json; none in a loop of your own.
        """
        keep_freed_memory()
        self.configuration = configuration
        self._traffic = traffic
        seed = configuration.seed if seed is None else seed
        self._watch = _watch(watch, configuration.recording.frames, out)
        if isinstance(network, BuiltNetwork):
            self._roads = RoadNetwork.from_highway(network)
        else:
            self._roads = RoadNetwork.from_net_file(network or traffic.net_file)
        self._lane_changes = LaneChanges(self._roads.graph, traffic.lane_ids)
        self._incidents = IncidentMaker(configuration.incidents, traffic, seed)
        offsets = {actor.id: actor.offset_m for actor in configuration.actors if actor.offset_m is not None}
        self._ego = Ego(self._roads, traffic, seed, configuration.driver, configuration.vehicle, offsets)
        self._script = ScriptPlayer(configuration.actors, configuration.script, traffic, self._ego)
        self._bend_speed = BendSpeed(configuration.driver, traffic)
        self._choice = EquipmentChoice(configuration.equipment, seed)
        self._equipped = np.zeros(256, np.bool_)  # by handle
        self._last_handle = -1
        self._own = OwnSensors(configuration, seed)
        self._vision = Vision(configuration, seed, threads, compare_paper)
        self._preview_m = configuration.camera.preview_m
        self._observing = observer.schedule(configuration.vehicle, self._preview_m, configuration.observing)
        self._predicting = prediction.predictor(configuration.vehicle, configuration.predicting)
        self._warning = departure.numbers(configuration.departure)
        self._ranging = Ranging(configuration, seed, self._roads)
        self._tracked = self._ranging.no_tracks()
        self._state = self._fresh(np.zeros(0, np.int64))
        self.recorder = Recorder(run_id, out, formats)
        if out is not None:
            capture.clear(out / capture.FRAMES)
            write_configuration(out, configuration, run_id, scenario, compare_paper)
        self._capture = (
            None if self._watch is None else Capture(self._watch, self._vision, configuration, run_id)
        )
        self._rear_end = rear_end.RearEndScorer(self.recorder, traffic, self._roads, configuration)
        self._names: dict[int, str] = {}  # of the equipped, those that left lately among them
        self._vehicles = 0  # equipped so far
        self._listeners = Listeners(configuration.reaction, seed, traffic.vehicle_id)
        self._alerted = np.zeros(0, np.int64)  # handles of those who hear a lane-departure warning and listen
        labels = {"lane_id": traffic.lane_ids, "tlc_side": ("left", "right"), "ldw_state": departure.CODES}
        labels |= rear_end.LABELS
        self._scorer = Scorer(self.recorder, self._names, labels, configuration.matching)
        self._steps = 0
        self._seed = seed
        self._begin_s = self._end_s = np.nan
        self._closed = False
        self.latest: Latest | None = None  # None while no equipped vehicle drives

    @classmethod
    def attach(
        cls,
        simulation: Any,
        equip: float | None = None,
        seed: int | None = None,
        *,
        settings: Configuration | Mapping[str, Any] | Path | str | None = None,
        **options: Any,
    ) -> "DriverAssistance":
        """Equip vehicles of a simulation that runs already.

        simulation : the module libsumo or traci, or a traci Connection, with a step length of 0.1 s.
        equip : share of the vehicles that are equipped; default: that of the settings.
        seed : of equipment, drivers and sensors.
        settings : a Configuration, a nested mapping with the same keys, or a TOML file.
        options : `out`, `formats`, `run_id`, `threads`, `compare_paper`, `watch`, as for the class.

        Raises TrafficError or SettingsError, before anything is changed.
        """
        if isinstance(settings, str | Path):
            settings = read_toml(Path(settings))
        if not isinstance(settings, Configuration):
            mapping = dict(settings or {})
            if equip is not None:
                mapping["equipment"] = {**mapping.get("equipment", {}), "fraction": equip}
            settings = configuration_from(mapping, "settings")
        elif equip is not None:
            raise ValueError("equip and a whole Configuration: set equipment.fraction in it instead")
        return cls(Traffic.attach(simulation), settings, seed=seed, **options)

    def __enter__(self) -> "DriverAssistance":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def vehicles(self) -> list[str]:
        """Ids of the equipped vehicles that are on the road now."""
        return [self._names[int(handle)] for handle in self._state.handle]

    @property
    def tables(self) -> "Tables":
        """The tables by name, as pandas DataFrames; complete after `close`."""
        return Tables(self.recorder)

    def step(self) -> None:
        """Work through the 0.1 s that SUMO has just simulated."""
        snapshot = self._traffic.snapshot()
        equipped = self._find_equipped(snapshot)
        truth = self._ego.step(snapshot, equipped, self._alerted)
        self._incidents.step(snapshot)
        self._steps += 1
        self._end_s = self._traffic.time_s
        if self._steps == 1:
            self._begin_s = self._end_s
        spans = self._ego.half_span_m()
        if len(truth.handle):
            self._traffic.write_lateral(truth.handle, self._ego.front_lateral_m())
            self._bend_speed.step(truth, self._roads.table)
            sensed = self._lane_changes.step(snapshot, equipped)
            if self._capture is not None and self._watch is not None and self._watch.alone:
                seen = self._capture.watched(truth.handle)
                truth, spans = select(truth, seen), spans[seen]
        self._follow_fleet(truth.handle)
        self.latest = None
        if len(truth.handle):
            self._drive(sensed, truth, spans)
        self._script.step(snapshot)
        if self._steps % SETTLE_EVERY_STEPS == 0:
            self._scorer.settle(self._traffic.time_s)
            self._rear_end.settle(self._traffic.time_s)
            if self._capture is not None:
                self._capture.settle()
            for handle in [one for one in self._names if not self._traffic.remembers(one)]:
                del self._names[handle]

    def look(self, handle: int) -> tuple[Look, dict[str, Any], dict[str, Any]] | None:
        """What a vehicle saw in the last step, its row of `steps` so far, and its rows of `tracks`.

        None for one that is not equipped, or not on the road.
        """
        if self.latest is None or handle not in self.latest.handle:
            return None
        row = int(np.searchsorted(self.latest.handle, handle))
        seen = select(capture.look(self._vision, self.latest.moment, np.array([row])), 0)
        tracks = self._rear_end.track_rows(self._rear_end.latest_of(handle))
        tracks["time_s"] = np.full(len(tracks["track_id"]), self.latest.moment.time_s)
        return seen, self._scorer.now(self.latest.columns, row), tracks

    def close(self) -> None:
        """Score and write what is left; safe to call twice. The simulation goes on."""
        if not self._closed:
            self._closed = True
            try:
                self._scorer.settle(np.inf, final=True)
                self._rear_end.settle(np.inf, final=True)
                self.recorder.append("runs", self._run_row())
            finally:
                if self._capture is not None:
                    self._capture.close()
                self._vision.close()
                self.recorder.close()

    def _run_row(self) -> dict[str, list[Any]]:
        row = {
            "seed": self._seed,
            "mode": self.configuration.mode,
            "configuration_hash": self.configuration.hash,
            "versions": versions(),
            "begin_s": self._begin_s,
            "end_s": self._end_s,
            "vehicles": self._vehicles,
            "vehicle_steps": self._scorer.vehicle_steps,
            "distance_km": self._scorer.distance_m / 1000.0,
            "departures": self._scorer.departures,
            "warnings": self._scorer.warnings,
            "conflicts": self._rear_end.conflicts,
            "collision_warnings": self._rear_end.warnings,
        }
        return {name: [value] for name, value in row.items()}

    def _find_equipped(self, snapshot: Snapshot) -> Array:
        new = snapshot.handle[snapshot.handle > self._last_handle].tolist()
        if new:
            self._last_handle = max(new)
            while self._last_handle >= len(self._equipped):
                self._equipped = np.concatenate([self._equipped, np.zeros_like(self._equipped)])
            chosen = self._choice.choose(self._traffic, new)
            self._equipped[chosen] = True
            names = {handle: self._traffic.vehicle_id(handle) for handle in chosen}
            self._vehicles += len(chosen)
            self._names.update(names)
            if self._capture is not None:
                self._capture.arrived(names)
        return np.asarray(self._equipped[snapshot.handle])

    def _fresh(self, handle: Array) -> FleetState:
        n = len(handle)
        names = [self._names[int(h)] for h in handle] if n else []
        return FleetState(
            handle,
            self._own.init(names),
            self._vision.init(names),
            observer.init(n, self._observing),
            departure.init(n),
            self._ranging.init(names),
        )

    def _follow_fleet(self, handle: Array) -> None:
        have = self._state.handle
        if np.array_equal(have, handle):
            return
        kept = np.isin(have, handle, assume_unique=True)
        arrived = handle[~np.isin(handle, have, assume_unique=True)]
        merged = join(select(self._state, kept), self._fresh(arrived))
        self._state = select(merged, np.argsort(merged.handle))
        before = {one: row for row, one in enumerate(have.tolist())}
        rows = np.array([before.get(one, -1) for one in handle.tolist()], np.int64)
        self._tracked = self._ranging.reindex(self._tracked, rows)

    def _drive(self, snapshot: Snapshot, truth: EgoTruth, spans: Array) -> None:
        configuration, state = self.configuration, self._state
        ahead = road_ahead(
            self._roads.table, truth.path, truth.station_m, truth.path_offset_m, truth.path_heading_rad
        )
        pose = Pose(truth.x_m, truth.y_m, truth.heading_rad)
        objects = objects_around(truth, snapshot)
        scene = Scene(ahead, objects, pose, truth.lanes_left, truth.lane_offset_m, truth.lane_width_m)
        sensors, own = self._own.step(state.own, truth)
        speed = own.readings.speed_mps
        vision, sight = self._vision.step(state.vision, scene, speed, self._own.turning(own, state.observer))
        observing, motion = observer.step(state.observer, self._observing, sight.lane, speed, own.observed)
        paths, crossings = self._foresee(motion, speed, spans)
        actual = true_motion(truth, ahead, self._preview_m)
        actual_path = prediction.predict(actual, truth.speed_mps, self._predicting)
        floor = time_to_lane_crossing(actual, actual_path, configuration.vehicle, spans)
        warning_state, warning = departure.step(
            state.departure, crossings["predicted"], motion, speed, truth.signal, self._warning
        )
        readings = self._own.for_radar(own, observing, motion)
        ranging, self._tracked, echo = self._ranging.step(
            state.ranging, self._tracked, truth, snapshot, motion, readings, sight.rear
        )
        unseen_s = self._tracked.tracker.tracks.unseen_s
        bodies = bodies_ahead(echo.tracks, unseen_s, speed, readings.yaw_rate_rps)
        vision = self._vision.told(vision, bodies, echo.watched)
        self._state = FleetState(truth.handle, sensors, vision, observing, warning_state, ranging)
        self._alerted = self._listeners.of(truth.handle, warning.side != 0)
        braking = self._listeners.of(truth.handle, echo.warning.level > 0)
        self._incidents.look_ahead(braking, configuration.reaction.rear_end_s)
        left, right = margins(truth, configuration.vehicle.front_axle_m, spans)
        columns = step_columns.of_time(self._steps, self._traffic.time_s, truth.handle)
        columns |= step_columns.of_truth(truth, snapshot) | {"margin_left_m": left, "margin_right_m": right}
        columns["true_curvature_1pm"] = curvature_ahead(ahead, self._preview_m)
        columns |= step_columns.of_sight(sight) | step_columns.of_motion(motion)
        columns |= step_columns.of_warning(crossings, floor, warning)
        columns |= step_columns.of_paths(paths | {"true_state": actual_path})
        columns |= self._rear_end.add(snapshot, truth, echo)
        self._scorer.add(columns)
        now = Moment(
            self._traffic.time_s, truth.handle, state.vision, scene, sight, vision, paths["predicted"]
        )
        self.latest = Latest(truth.handle, warning.code, echo.warning.code, now, columns)
        if self._capture is not None:
            self._capture.add(now, self._rear_end)

    def _foresee(
        self, motion: MotionEstimate, speed: Array, spans: Array
    ) -> tuple[dict[str, Trajectory], dict[str, Crossing]]:
        paths = {
            "predicted": prediction.predict(motion, speed, self._predicting),
            "constant_velocity": prediction.constant_velocity(motion, speed, self._predicting),
            "constant_radius": prediction.constant_radius(motion, speed, self._predicting),
        }
        vehicle = self.configuration.vehicle
        return paths, {
            name: time_to_lane_crossing(motion, path, vehicle, spans) for name, path in paths.items()
        }


def _watch(watch: Watch | None, count: int, out: Path | None) -> Watch | None:
    if watch is not None or not count:
        return watch
    if out is None:
        raise ValueError(f"recording.frames = {count}: frames need a directory, name one as `out`")
    return Watch(out / capture.FRAMES, count=count)


class Tables(Mapping[str, pd.DataFrame]):
    """The tables of a run by name, read when asked for."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self._recorder.table(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._recorder.names)

    def __len__(self) -> int:
        return len(self._recorder.names)
