"""Cost of a step by stage: a stopwatch around the functions of a running assistance."""

import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

CHAIN = ("road ahead", "render", "search", "detect", "observe", "predict", "warn")
RADAR = ("radar", "track", "warn rear end")
SHARED = ("SUMO", "read state")  # cost of all traffic, equipped or not
STAGES = (*CHAIN, *RADAR, "ego", "write state", "judge", "baselines", "tables", "rest", *SHARED)
HEAVY = {"demand": {"flow_per_lane_vph": 2200.0, "truck": {"share": 0.05}}, "highway": {"lanes": 4}}
CROWDED = HEAVY | {"highway": {"lanes": 6}}
MOST_IN_HEAVY = 550  # vehicles; larger fleets need more lanes
FILL_STEPS = 600  # SUMO alone, until the number of vehicles is steady
WARM_UP_STEPS = 15


class Stopwatch:
    """Exclusive processor time by stage: nested stages are not counted twice.

    Its own cost, 1.4 µs for each of some 55 calls timed in a step, is measured first and left out.
    """

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._open: list[str] = []
        self._since = self._within_s = self._around_s = 0.0
        self._within_s, self._around_s = self._own_cost()

    def _own_cost(self, calls: int = 2000) -> tuple[float, float]:
        """What a timed call adds to its own stage, and to the one around it, in s."""
        begin = time.process_time()
        for _ in range(calls):
            _nothing()
        plain = (time.process_time() - begin) / calls
        timed = self._timed(_nothing, "within")
        with self.stage("around"):
            for _ in range(calls):
                timed()
        spent = self.take()
        return max(spent["within"] / calls - plain, 0.0), max(spent["around"] / calls, 0.0)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self._begin(name)
        try:
            yield
        finally:
            self._end()

    def time(self, owner: Any, attribute: str, name: str) -> None:
        """Time a function from now on."""
        setattr(owner, attribute, self._timed(getattr(owner, attribute), name))

    def _timed(self, inner: Callable[..., Any], name: str) -> Callable[..., Any]:
        def timed(*arguments: Any, **options: Any) -> Any:
            self._begin(name)  # not `stage`: a generator costs 1 µs more, which matters for one vehicle
            try:
                return inner(*arguments, **options)
            finally:
                self._end()

        return timed

    def take(self) -> dict[str, float]:
        """Seconds by stage since the last call."""
        taken, self.spent = dict(self.spent), defaultdict(float)
        return taken

    def _begin(self, name: str) -> None:
        now = time.process_time()
        if self._open:
            self.spent[self._open[-1]] += now - self._since
        self._open.append(name)
        self._since = now

    def _end(self) -> None:
        now = time.process_time()
        self.spent[self._open.pop()] += now - self._since - self._within_s
        if self._open:
            self.spent[self._open[-1]] -= self._around_s
        self._since = now


def _nothing() -> None: ...


class FirstOnes:
    """Equips light vehicles as they depart, until there are enough of them on the road."""

    def __init__(self, fleet: int, driving: Callable[[], int]) -> None:
        self._fleet, self._driving = fleet, driving

    def choose(self, traffic: Any, handles: list[int]) -> list[int]:
        from sumo_net.equipment import LIGHT_CLASSES

        light = [handle for handle in handles if traffic.vehicle_class(handle) in LIGHT_CLASSES]
        return light[: max(self._fleet - self._driving(), 0)]

    def by_class(self) -> str:
        """Not counted."""
        return ""


def functions() -> tuple[tuple[Any, str, str], ...]:
    """Functions to time: owner, name of the function, stage."""
    from plugin import chain, ranging, step_columns, vision
    from plugin.ground_truth import Judge
    from plugin.lane import genetic, refine
    from plugin.motion import observer, prediction
    from plugin.own_motion import OwnSensors
    from plugin.rear_end import RearEndScorer
    from plugin.tracking.tracker import Tracker
    from plugin.truth import Scorer
    from plugin.warning import collision, departure
    from sumo_net.ego import Ego
    from sumo_net.incidents import IncidentMaker
    from sumo_net.lane_changes import LaneChanges
    from sumo_net.traffic import Traffic

    return (
        (chain, "road_ahead", "road ahead"),
        (chain, "objects_around", "road ahead"),
        (vision.Vision, "draw", "render"),
        (vision.Vision, "step", "detect"),  # the rest of it: slicing and joining
        (vision.Vision, "_judge", "judge"),
        (vision.Vision, "with_bodies", "detect"),
        (chain, "bodies_ahead", "detect"),
        (genetic, "search", "search"),
        (refine, "step", "detect"),
        (refine, "border_columns", "judge"),
        (refine, "parabolas", "tables"),
        (OwnSensors, "step", "observe"),
        (observer, "step", "observe"),
        (departure, "step", "warn"),
        (ranging.Ranging, "step", "radar"),
        (Tracker, "step", "track"),
        (collision, "step", "warn rear end"),
        *((RearEndScorer, name, "tables") for name in ("leaders", "judge", "add")),
        (RearEndScorer, "settle", "tables"),
        (prediction, "predict", "predict"),
        (chain, "time_to_lane_crossing", "warn"),
        (Judge, "reference", "baselines"),
        *((step_columns, name, "tables") for name in vars(step_columns) if name.startswith("of_")),
        (Scorer, "add", "tables"),
        (Scorer, "settle", "tables"),
        (Ego, "step", "ego"),
        (Ego, "front_lateral_m", "ego"),
        (Traffic, "write_lateral", "write state"),
        (LaneChanges, "step", "read state"),
        (Traffic, "snapshot", "read state"),
        (Traffic, "accelerations_mps2", "read state"),
        (IncidentMaker, "step", "SUMO"),
        (Traffic, "step", "SUMO"),
    )


def watch(clock: Stopwatch) -> None:
    """Put the stopwatch around the stages of the assistance."""
    for owner, attribute, name in functions():
        clock.time(owner, attribute, name)


def stages_of_fleet(fleet: int, steps: int, mode: str = "refined") -> dict[str, Any]:
    """Milliseconds of processor time per vehicle-step by stage, and memory; `steps` steps in ten blocks."""
    clock, blocks = Stopwatch(), 10
    watch(clock)
    with assistance(fleet, mode, threads=1) as (traffic, adas):
        before = resident_mb()
        for _ in range(WARM_UP_STEPS):
            traffic.step()
            adas.step()
        adas._scorer.settle(traffic.time_s)
        clock.take()
        spent, counts, vehicles = [], [], []
        for block in range(blocks):
            done = adas._scorer.vehicle_steps
            for _ in range(max(1, steps // blocks)):
                with clock.stage("rest"):
                    traffic.step()
                    adas.step()
            if block == blocks - 1:
                with clock.stage("tables"):  # scored and written once for all steps, as in a run
                    adas._scorer.settle(traffic.time_s)
                    adas._rear_end.settle(traffic.time_s)
            spent.append(clock.take())
            counts.append(adas._scorer.vehicle_steps - done)
            vehicles.append(len(adas.vehicles))
        after = resident_mb()
        traffic_size = len(traffic.snapshot().handle)
    per_vehicle = {
        name: np.array([1e3 * part.get(name, 0.0) for part in spent]) / np.array(counts) for name in STAGES
    }
    per_vehicle["tables"][:] = 1e3 * sum(part.get("tables", 0.0) for part in spent) / sum(counts)
    whole = sum(per_vehicle[name] for name in STAGES)
    return {
        "fleet": float(np.median(vehicles)),
        "vehicles_in_traffic": traffic_size,
        "mode": mode,
        "vehicle_steps": int(sum(counts)),
        "stages_ms": {name: float(np.median(per_vehicle[name])) for name in STAGES},
        "camera_ms": float(np.median(sum(per_vehicle[name] for name in CHAIN))),
        "radar_ms": float(np.median(sum(per_vehicle[name] for name in RADAR))),
        "own_ms": float(np.median(whole - sum(per_vehicle[name] for name in SHARED))),
        "whole_step_ms": float(np.median(whole)),
        "whole_step_lowest_ms": float(whole.min()),
        "sumo_ms_per_step": float(np.median([1e3 * s.get("SUMO", 0.0) / max(1, steps // 10) for s in spent])),
        "read_ms_per_step": float(
            np.median([1e3 * s.get("read state", 0.0) / max(1, steps // 10) for s in spent])
        ),
        "resident_mb": after,
        "fleet_mb": after - before,
    }


def search_by_frame(repeats: int = 5) -> dict[str, float]:
    """Milliseconds for both borders by the published search: in frame 1, frames 2 to 6, and later ones."""
    from plugin.lane import genetic
    from plugin.lane.genetic import GeneticSearch, search_numbers

    taken: list[Any] = []
    with assistance(16, "refined", threads=1) as (traffic, adas):
        look = adas._chain.vision._look
        adas._chain.vision._look = lambda frames, *rest: (taken.append(frames.copy()), look(frames, *rest))[1]
        for _ in range(10):
            traffic.step()
            adas.step()
    frames = [one for one in taken if len(one) == len(taken[-1])]
    numbers, n = search_numbers(GeneticSearch()), len(frames[-1])
    spent: dict[str, list[float]] = {"first": [], "second to sixth": [], "later": []}
    for repeat in range(repeats):
        state = genetic.init(np.arange(n, dtype=np.uint64) + np.uint64(1000 * repeat))
        for number in range(10):
            begin = time.process_time()
            state, _ = genetic.search(frames[number % len(frames)], state, numbers)
            name = "first" if number == 0 else "second to sixth" if number < 6 else "later"
            spent[name].append(1e3 * (time.process_time() - begin) / n)
    return {name: float(np.median(part)) for name, part in spent.items()}


def against_real_time(fleet: int, threads: int, seconds: float, repeats: int) -> dict[str, Any]:
    """Simulated seconds per second for `fleet` equipped vehicles in heavy traffic, tables on disk.

    Once by wall-clock time, which a user sees, and once by processor time divided among `threads` cores,
    which other load does not affect.
    """
    wall, processor, vehicles = [], [], []
    with (
        tempfile.TemporaryDirectory() as out,
        assistance(fleet, "refined", threads, Path(out)) as (traffic, adas),
    ):
        for _ in range(WARM_UP_STEPS):
            traffic.step()
            adas.step()
        for _ in range(repeats):
            before = time.perf_counter(), time.process_time()
            for _ in range(round(seconds * 10)):
                traffic.step()
                adas.step()
            wall.append(seconds / (time.perf_counter() - before[0]))
            processor.append((time.process_time() - before[1]) / seconds)
            vehicles.append(len(adas.vehicles))
    return {
        "fleet": float(np.median(vehicles)),
        "threads": threads,
        "real_time_factor": float(np.median(wall)),
        "processor_s_per_simulated_s": float(np.median(processor)),
        "load_average": os.getloadavg()[0],
    }


@contextmanager
def assistance(fleet: int, mode: str, threads: int, out: Path | None = None) -> Iterator[tuple[Any, Any]]:
    """Traffic and assistance on a full highway, whose next departing light vehicles are equipped."""
    from plugin.assistance import DriverAssistance
    from plugin.configuration import load_configuration
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

    world = HEAVY if fleet <= MOST_IN_HEAVY else CROWDED
    changes = {**world, "duration_s": 3600.0, "mode": mode, "condition": "complex", "seed": 50}
    configuration = load_configuration("highway", changes)
    with tempfile.TemporaryDirectory() as work:
        prepared = prepare(configuration, Path(work))
        with (
            Traffic.start(prepared.arguments) as traffic,
            DriverAssistance(traffic, configuration, prepared.network, out=out, threads=threads) as adas,
        ):
            adas._choice = FirstOnes(fleet, lambda: len(adas.vehicles))  # type: ignore[assignment]
            for _ in range(FILL_STEPS):
                traffic.step()
            yield traffic, adas


def resident_mb() -> float:
    """Memory of this process that is in use, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
