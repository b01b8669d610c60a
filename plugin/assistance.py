"""The assistance of a running simulation: SUMO -> truth -> the fleet's chains -> tables, each 0.1 s."""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from plugin import capture, rear_end, step_columns
from plugin.capture import Capture, Look, Watch
from plugin.chain import Chain, Moment, Outcome
from plugin.compiled import compiled
from plugin.configuration import Configuration, configuration_from, versions, write_configuration
from plugin.fleet import Fleet
from plugin.lane.detector import LaneDetector
from plugin.reaction import Listeners
from plugin.record import MOST_WAITING, Recorder
from plugin.truth import Scorer
from plugin.warning import departure
from sumo_net.arrays import Array
from sumo_net.batch import ALL, join, longer, select
from sumo_net.bend_speed import BendSpeed
from sumo_net.ego import Ego, EgoTruth, as_driven
from sumo_net.equipment import EquipmentChoice
from sumo_net.incidents import IncidentMaker
from sumo_net.lane_changes import LaneChanges
from sumo_net.memory import keep_freed_memory
from sumo_net.network import BuiltNetwork
from sumo_net.opposite import OppositeLanes
from sumo_net.road import RoadNetwork
from sumo_net.script_player import ScriptPlayer
from sumo_net.settings import read_toml
from sumo_net.snapshot import Snapshot
from sumo_net.step import STEP_S
from sumo_net.traffic import Traffic, TrafficError

SETTLE_EVERY_STEPS = 100  # rows are scored and written every 10 s of simulated time …
WRITE_EVERY_STEPS = 10  # … those of `tracks`, scored at once, every second in which there are so many
WORTH_WRITING = 10_000


class Latest(NamedTuple):
    """The last step of n vehicles, for live displays."""

    time_s: float
    handle: Array  # (n,) int64
    departure_code: Array  # (n,) int8, index into plugin.warning.departure.CODES
    collision_code: Array  # (n,) int8, index into plugin.warning.collision.CODES
    columns: dict[str, Any]  # of the table `steps`, as far as they are known; text as codes
    moments: list[Moment]  # one for each part of the fleet


class Seen(NamedTuple):
    """What a vehicle saw and estimated in the last step."""

    camera: Look  # its frame, borders, predicted path, and the truth around it
    step: pd.Series  # its row of `last_step`
    tracks: pd.DataFrame  # its rows of `tracks`, also of tracks that are not recorded


class DriverAssistance:
    """Lane-departure and rear-end warning for the equipped vehicles of a running SUMO simulation.

    Use `attach` in a loop of your own and call `step` after each simulation step; `tables` gives what was
    recorded. Close it, or use it as a context manager: the last seconds are scored and written then.
    """

    def __init__(
        self,
        traffic: Traffic,
        configuration: Configuration,
        network: BuiltNetwork | Path | None = None,
        *,
        out: Path | str | None = None,
        formats: Iterable[str] | str = ("csv",),
        run_id: str = "run",
        seed: int | None = None,
        threads: int | None = None,
        compare_paper: bool = False,
        watch: Watch | None = None,
        detector: LaneDetector[Any] | None = None,
        scenario: str = "",
    ) -> None:
        """`network`: source of the smooth road, by default the network file that SUMO has loaded.

        `watch`: which vehicles' camera frames are kept, and where; default: `recording.frames`, in `out`.
        `detector`: finds the lane in place of the one that `mode` names; configuration.json only
        has the name of its class.
        `scenario`: its name, for configuration.json; empty in a loop of your own.
        """
        keep_freed_memory()
        out = None if out is None else Path(out)
        self.configuration = configuration
        self._traffic = traffic
        seed = configuration.seed if seed is None else seed
        self._watch = _watch(watch, configuration.recording.frames, out)
        if isinstance(network, BuiltNetwork):
            self._roads = RoadNetwork.from_highway(network)
        else:
            self._roads = RoadNetwork.from_net_file(network or traffic.net_file)
        self._opposite = OppositeLanes(self._roads.graph, traffic)
        self._lane_changes = LaneChanges(self._roads.graph, traffic.lane_ids)
        self._incidents = IncidentMaker(configuration.incidents, traffic, seed)
        offsets = {actor.id: actor.offset_m for actor in configuration.actors if actor.offset_m is not None}
        self._ego = Ego(self._roads, traffic, seed, configuration.driver, configuration.vehicle, offsets)
        self._script = ScriptPlayer(configuration.actors, configuration.script, traffic, self._ego)
        self._bend_speed = BendSpeed(configuration.driver, traffic)
        self._choice = EquipmentChoice(configuration.equipment, seed)
        self._equipped = np.zeros(256, np.bool_)  # by handle
        self._last_handle = -1
        self._chain = Chain(configuration, seed, self._roads, compare_paper, detector)
        self._names: dict[int, str] = {}  # of equipped vehicles, also those that left recently
        self._fleet = Fleet(self._chain, self._names.__getitem__, threads)
        self.recorder = Recorder(run_id, out, formats, aside=out is not None)
        if out is not None:
            capture.clear(out / capture.FRAMES)
            write_configuration(out, configuration, run_id, scenario, compare_paper, detector)
        self._capture = (
            None if self._watch is None else Capture(self._watch, self._chain.vision, configuration, run_id)
        )
        self._rear_end = rear_end.RearEndScorer(self.recorder, traffic, self._roads, configuration)
        self._vehicles = 0  # equipped so far
        self._listeners = Listeners(configuration.reaction, seed, traffic.vehicle_id)
        self._alerted = np.zeros(0, np.int64)  # handles whose drivers react to a lane-departure warning
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
        """Equip vehicles of a running simulation.

        simulation : the module libsumo or traci, or a traci Connection, with a step length of 0.1 s.
        equip : share of the vehicles that are equipped; default: that of the settings.
        seed : of equipment, drivers and sensors.
        settings : a Configuration, a nested mapping with the same keys, or a TOML file.
        options : `out`, `formats`, `run_id`, `threads`, `compare_paper`, `watch`, `detector`, as for the
            class.

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
            raise ValueError("equip cannot be given with a Configuration: set its equipment.fraction instead")
        assistance = cls(Traffic.attach(simulation), settings, seed=seed, **options)
        if not compiled():
            logging.getLogger(__name__).warning("compiling in the first steps, once: one or two minutes")
        return assistance

    def __enter__(self) -> "DriverAssistance":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def vehicles(self) -> list[str]:
        """Ids of the equipped vehicles that are on the road now."""
        return [self._names[handle] for handle in self._fleet.handle.tolist()]

    @property
    def tables(self) -> "Tables":
        """The tables by name, as pandas DataFrames; complete after `close`."""
        return Tables(self.recorder)

    def step(self) -> None:
        """Process the 0.1 s that SUMO has just simulated.

        Raises TrafficError and changes nothing unless SUMO's time has advanced by 0.1 s since the last call.
        """
        if self._closed:
            raise TrafficError("this assistance is closed: attach again")
        snapshot = self._opposite.step(self._traffic.snapshot())
        self._check_time()
        equipped = self._find_equipped(snapshot)
        truth = self._ego.step(snapshot, equipped, self._alerted)
        self._steps += 1
        self._end_s = self._traffic.time_s
        if self._steps == 1:
            self._begin_s = self._end_s
        self.latest = None
        seen = self._sensing(truth)
        self._fleet.follow(truth.handle[seen])
        if len(truth.handle):
            sensed = self._lane_changes.step(snapshot, equipped)
            sensed = as_driven(sensed, truth, self.configuration.vehicle.bumper_m)
        if len(truth.handle[seen]):
            spans = self._ego.half_span_m()[seen]
            self._drive(sensed, select(truth, seen), spans, lambda: self._write_to_sumo(snapshot, truth))
        else:
            self._write_to_sumo(snapshot, truth)
        self._script.step(snapshot)
        self.recorder.flush(MOST_WAITING)  # raises an error such as a full disk now, not with the next rows
        if self._steps % WRITE_EVERY_STEPS == 0:
            self._rear_end.write_tracks(WORTH_WRITING)
        if self._steps % SETTLE_EVERY_STEPS == 0:
            self._scorer.settle(self._traffic.time_s)
            self._rear_end.settle(self._traffic.time_s)
            if self._capture is not None:
                self._capture.settle()
            for handle in [one for one in self._names if one not in self._traffic.names]:
                del self._names[handle]

    @property
    def last_step(self) -> pd.DataFrame:
        """The rows of `steps` of the last step, as far as they are known yet; no row while nobody drives.

        True times to crossing are empty: they depend on what follows.
        """
        columns = {} if self.latest is None else self._scorer.now(self.latest.columns)
        return self.recorder.unwritten("steps", columns)

    def look(self, vehicle_id: str) -> Seen | None:
        """What a vehicle saw in the last step; None for one that is not equipped, or not on the road."""
        latest = self.latest
        if latest is None or vehicle_id not in self.vehicles:
            return None
        handle = self._traffic.handle(vehicle_id)
        moment = next(one for one in latest.moments if handle in one.handle)
        row = int(np.searchsorted(moment.handle, handle))
        camera = select(capture.look(self._chain.vision, moment, np.array([row])), 0)
        step = self.last_step.iloc[int(np.searchsorted(latest.handle, handle))]
        return Seen(camera, step, self.recorder.unwritten("tracks", self._rear_end.latest_of(handle)))

    def close(self) -> None:
        """Score and write what is left; safe to call twice. The simulation goes on."""
        if not self._closed:
            self._closed = True
            try:
                self._scorer.settle(np.inf, final=True)
                self._rear_end.settle(np.inf, final=True)
                self.recorder.flush()  # the counts are complete only then
                self.recorder.append("runs", self._run_row())
            finally:
                if self._capture is not None:
                    self._capture.close()
                self._fleet.close()
                self.recorder.close()

    def _check_time(self) -> None:
        now_s = self._traffic.time_s
        if self._steps and abs(now_s - self._end_s - STEP_S) > STEP_S / 100.0:
            raise TrafficError(
                f"SUMO's time went from {self._end_s:.2f} to {now_s:.2f} s: call step() once after every "
                f"step of {STEP_S:g} s; after loadState, close this and attach again"
            )

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
            "equipped_by_class": self._choice.by_class(),
        }
        return {name: [value] for name, value in row.items()}

    def _find_equipped(self, snapshot: Snapshot) -> Array:
        new = snapshot.handle[snapshot.handle > self._last_handle].tolist()
        if new:
            self._last_handle = max(new)
            self._equipped = longer(self._equipped, self._last_handle + 1)
            chosen = self._choice.choose(self._traffic, new)
            self._equipped[chosen] = True
            names = {handle: self._traffic.vehicle_id(handle) for handle in chosen}
            self._vehicles += len(chosen)
            self._names.update(names)
            if self._capture is not None:
                self._capture.arrived(names)
        return np.asarray(self._equipped[snapshot.handle])

    def _sensing(self, truth: EgoTruth) -> slice | Array:
        """Vehicles whose sensors run: all, or with `watch.alone` those whose frames are kept."""
        if self._capture is None or self._watch is None or not self._watch.alone:
            return ALL
        return self._capture.watched(truth.handle)

    def _write_to_sumo(self, snapshot: Snapshot, truth: EgoTruth) -> None:
        """Write incidents, and the equipped vehicles' lateral positions and bend speeds, to SUMO."""
        self._incidents.step(snapshot)
        if len(truth.handle):
            lateral_m = self._opposite.of_lane(truth.handle, self._ego.front_lateral_m())
            self._traffic.write_lateral(truth.handle, lateral_m)
            self._bend_speed.step(truth, self._roads.table)

    def _drive(
        self, snapshot: Snapshot, truth: EgoTruth, half_span_m: Array, meanwhile: Callable[[], None]
    ) -> None:
        """Run the chains of n > 0 vehicles and record the results; `meanwhile` runs while threads work."""
        time_s, leader = self._traffic.time_s, self._rear_end.leaders(snapshot, truth.handle)

        def judge(part: slice, outcome: Outcome) -> rear_end.Judged:
            return self._rear_end.judge(outcome.truth, outcome.echo, leader.handle[part])

        finish = self._fleet.step(truth, half_span_m, snapshot, judge)
        meanwhile()
        done = finish()
        outcomes = [outcome for outcome, _ in done]
        departing = join(*(one.warning for one in outcomes))
        closing = join(*(one.echo.warning for one in outcomes))
        self._alerted = self._listeners.of(truth.handle, departing.side != 0)
        braking = self._listeners.of(truth.handle, closing.level > 0)
        self._incidents.look_ahead(braking, self.configuration.reaction.rear_end_s)
        columns = step_columns.of_time(self._steps, time_s, truth.handle)
        columns |= step_columns.join(*(one.columns for one in outcomes))
        echoes = [(one.echo, judged) for one, judged in done]
        columns |= self._rear_end.add(truth, columns["lane_id"], leader, echoes)
        self._scorer.add(columns)
        moments = [one.moment for one in outcomes]
        self.latest = Latest(time_s, truth.handle, departing.code, closing.code, columns, moments)
        if self._capture is not None:
            for moment in moments:
                self._capture.add(time_s, moment, self._rear_end)


def _watch(watch: Watch | None, count: int, out: Path | None) -> Watch | None:
    if watch is not None or not count:
        return watch
    if out is None:
        raise ValueError(f"recording.frames = {count}: frames need a directory, give one as `out`")
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
