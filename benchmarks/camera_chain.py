"""What an equipped vehicle costs: the camera chain stage by stage, and a fleet against real time.

    python benchmarks/camera_chain.py [--fleets 1 10 100 500] [--blocks 10] [--out out/benchmark.json]

Each fleet drives in a process of its own through the built-in highway with four lanes in heavy traffic, the
same for all fleets, so that every camera sees as much. Stages are timed in processor time (other programs on
the machine do not count) on one thread, in blocks of steps; given is the median over the blocks. `chain` is
what the target is about: road ahead, render, detect, observe, predict, warn. Then 100 equipped vehicles run
on two threads in the default scenario, with SUMO and the tables on disk, against the clock on the wall.
"""

import argparse
import json
import multiprocessing
import os
import platform
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

CHAIN = ("road ahead", "render", "search", "detect", "observe", "predict", "warn")
STAGES = (*CHAIN, "radar", "SUMO", "read traffic", "ego", "judge", "baselines", "tables", "rest")
SHARED = ("SUMO", "read traffic")  # cost of the whole traffic, whoever is equipped
TARGET_MS = 0.6
SETTLE_STEPS = 100  # rows are scored and written so often
HEAVY = {"demand": {"flow_per_lane_vph": 2200.0, "truck": {"share": 0.05}}, "highway": {"lanes": 4}}
FILL_STEPS = 600  # SUMO alone, until as many vehicles drive as ever will
WARM_UP_STEPS = 30


class Stopwatch:
    """Exclusive processor time by stage: a stage inside another one is not counted twice."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._open: list[str] = []
        self._since = 0.0

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self._turn()
        self._open.append(name)
        try:
            yield
        finally:
            self._turn()
            self._open.pop()

    def time(self, owner: Any, attribute: str, name: str | Callable[..., str]) -> None:
        """Time a function from now on; `name` may depend on its arguments."""
        inner = getattr(owner, attribute)

        def timed(*arguments: Any, **options: Any) -> Any:
            with self.stage(name if isinstance(name, str) else name(*arguments)):
                return inner(*arguments, **options)

        setattr(owner, attribute, timed)

    def take(self) -> dict[str, float]:
        """Seconds by stage since the last call."""
        taken, self.spent = dict(self.spent), defaultdict(float)
        return taken

    def _turn(self) -> None:
        now = time.process_time()
        if self._open:
            self.spent[self._open[-1]] += now - self._since
        self._since = now


class FirstOnes:
    """Equips light vehicles as they come, until there are enough of them on the road."""

    def __init__(self, fleet: int, driving: Callable[[], int]) -> None:
        self._fleet, self._driving = fleet, driving

    def choose(self, traffic: Any, handles: list[int]) -> list[int]:
        from sumo_net.equipment import LIGHT_CLASSES

        light = [handle for handle in handles if traffic.vehicle_class(handle) in LIGHT_CLASSES]
        return light[: max(self._fleet - self._driving(), 0)]


def watch(clock: Stopwatch) -> None:
    """Put the stopwatch around the stages of the assistance."""
    from plugin import assistance, vision
    from plugin.lane import genetic, refine
    from plugin.motion import observer, prediction
    from plugin.ranging import Ranging
    from plugin.rear_end import RearEndScorer
    from plugin.truth import Scorer
    from plugin.warning import departure
    from sumo_net.ego import Ego
    from sumo_net.incidents import IncidentMaker
    from sumo_net.lane_changes import LaneChanges
    from sumo_net.traffic import Traffic

    clock.time(assistance, "road_ahead", "road ahead")
    clock.time(assistance, "objects_around", "road ahead")
    clock.time(vision.Vision, "draw", "render")
    clock.time(vision.Vision, "step", "detect")  # what is not in a stage of its own: slicing and joining
    clock.time(vision.Vision, "_judge", "judge")
    clock.time(vision.Vision, "told", "detect")
    clock.time(assistance, "bodies_ahead", "detect")
    clock.time(Ranging, "step", "radar")
    clock.time(RearEndScorer, "add", "tables")
    clock.time(RearEndScorer, "settle", "tables")
    clock.time(IncidentMaker, "step", "SUMO")
    clock.time(LaneChanges, "step", "read traffic")
    clock.time(genetic, "search", "search")
    clock.time(refine, "step", "detect")
    clock.time(refine, "border_columns", "judge")
    clock.time(refine, "parabolas", "tables")
    clock.time(observer, "step", "observe")
    clock.time(departure, "step", "warn")
    # The prediction from the estimate is part of the chain; the one from the true state is for the tables.
    seen: list[Any] = [None, None]
    observe, predict = observer.step, prediction.predict

    def observed(*arguments: Any) -> Any:
        result = observe(*arguments)
        seen[0] = result[1]
        return result

    def predicted(motion: Any, *arguments: Any) -> Any:
        own = motion is seen[0]
        with clock.stage("predict" if own else "baselines"):
            path = predict(motion, *arguments)
        if own:
            seen[1] = path
        return path

    observer.step, prediction.predict = observed, predicted  # type: ignore[assignment]
    clock.time(prediction, "constant_velocity", "baselines")
    clock.time(prediction, "constant_radius", "baselines")
    clock.time(
        assistance,
        "time_to_lane_crossing",
        lambda motion, path, *_: "warn" if path is seen[1] else "baselines",
    )
    clock.time(assistance, "true_motion", "baselines")
    clock.time(assistance.DriverAssistance, "_columns", "tables")
    clock.time(Scorer, "add", "tables")
    clock.time(Scorer, "settle", "tables")
    clock.time(Ego, "step", "ego")
    clock.time(Ego, "front_lateral_m", "ego")
    clock.time(Traffic, "write_lateral", "ego")
    clock.time(Traffic, "snapshot", "read traffic")
    clock.time(Traffic, "step", "SUMO")


def stages_of_fleet(fleet: int, blocks: int, mode: str) -> dict[str, Any]:
    """Milliseconds of processor time a vehicle-step by stage (SHARED: a step), medians over `blocks`."""
    clock = Stopwatch()
    watch(clock)
    steps = max(1, SETTLE_STEPS // blocks)
    with _assistance(fleet, HEAVY, mode, threads=1) as (traffic, adas):
        for _ in range(WARM_UP_STEPS):
            traffic.step()
            adas.step()
        adas._steps = 0  # exactly one scoring pass falls into the measured steps
        adas._scorer.settle(traffic.time_s)
        clock.take()
        spent, counts, vehicles = [], [], []
        for _ in range(blocks):
            before = adas._scorer.vehicle_steps
            for _ in range(steps):
                with clock.stage("rest"):
                    traffic.step()
                    adas.step()
            spent.append(clock.take())
            counts.append(adas._scorer.vehicle_steps - before)
            vehicles.append(len(adas.vehicles))
        repeated = _repeated(traffic, adas, clock)
        traffic_size = len(traffic.snapshot().handle)
    per_vehicle = {
        name: np.array([1e3 * part.get(name, 0.0) for part in spent]) / np.array(counts) for name in STAGES
    }
    # The scoring pass is one block's burden: its share is spread over all of them.
    per_vehicle["tables"][:] = 1e3 * sum(part.get("tables", 0.0) for part in spent) / sum(counts)
    chain = sum(per_vehicle[name] for name in CHAIN)
    whole = sum(per_vehicle[name] for name in STAGES)
    return {
        "fleet": float(np.median(vehicles)),
        "vehicles_in_traffic": traffic_size,
        "mode": mode,
        "vehicle_steps": int(sum(counts)),
        "stages_ms": {name: float(np.median(per_vehicle[name])) for name in STAGES},
        "shared_ms_per_step": {
            name: float(np.median([1e3 * part.get(name, 0.0) / steps for part in spent])) for name in SHARED
        },
        "chain_ms": float(np.median(chain)),
        "chain_ms_range": [float(chain.min()), float(chain.max())],
        "chain_repeated_ms": repeated,
        "whole_step_ms": float(np.median(whole)),
    }


def _repeated(traffic: Any, adas: Any, clock: Stopwatch) -> float:
    """The chain when one and the same step is worked through again and again, median."""
    inputs: list[Any] = []
    drive = adas._drive
    adas._drive = lambda *arguments: inputs.append((adas._state, arguments))
    traffic.step()
    adas.step()
    state, arguments = inputs[0]
    clock.take()
    found = []
    for _ in range(max(5, 500 // len(state.handle))):
        adas._state = state
        drive(*arguments)
        spent = clock.take()
        found.append(1e3 * sum(spent.get(name, 0.0) for name in CHAIN) / len(state.handle))
    del adas._drive
    return float(np.median(found))


def against_real_time(fleet: int, threads: int, seconds: float, repeats: int) -> dict[str, Any]:
    """Simulated seconds a second for `fleet` equipped vehicles in the default scenario, tables on disk.

    On the wall, and as it would be were the processor time spread evenly over the threads and nothing else
    running: the first is what a user sees, the second what a busy machine cannot hide.
    """
    wall, processor, vehicles = [], [], []
    with (
        tempfile.TemporaryDirectory() as out,
        _assistance(fleet, {}, "refined", threads, Path(out)) as (traffic, adas),
    ):
        for _ in range(WARM_UP_STEPS):
            traffic.step()
            adas.step()
        adas._steps = 0
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
        "real_time_factor_range": [min(wall), max(wall)],
        "processor_s_per_simulated_s": float(np.median(processor)),
        "load_average": os.getloadavg()[0],
    }


@contextmanager
def _assistance(
    fleet: int, world: dict[str, Any], mode: str, threads: int, out: Path | None = None
) -> Iterator[tuple[Any, Any]]:
    from plugin.assistance import DriverAssistance
    from plugin.configuration import load_configuration
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

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


def _in_process(function: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def print_stages(console: Console, results: list[dict[str, Any]]) -> None:
    """One column a fleet."""
    console.print("ms of processor time a vehicle-step, one thread, by number of equipped vehicles")
    table = Table(box=None)
    table.add_column("stage", no_wrap=True)
    for result in results:
        note = " paper" if result["mode"] == "paper" else ""
        table.add_column(f"{result['fleet']:.0f}{note}", justify="right")
    for name in STAGES:
        mark = "" if name in CHAIN else "  "
        table.add_row(mark + name, *(f"{result['stages_ms'][name]:.4f}" for result in results))
    table.add_row(f"chain (target {TARGET_MS})", *(f"{result['chain_ms']:.3f}" for result in results))
    for k, name in enumerate(("lowest", "highest")):
        table.add_row(f"  {name} block", *(f"{result['chain_ms_range'][k]:.3f}" for result in results))
    table.add_row("  repeated", *(f"{result['chain_repeated_ms']:.3f}" for result in results))
    table.add_row("whole step", *(f"{result['whole_step_ms']:.3f}" for result in results))
    console.print(table)
    console.print(
        f"SUMO and its reading: all {results[0]['vehicles_in_traffic']} vehicles, equipped or not. "
        "repeated: the same step\nagain and again, so that SUMO does not push the chain out of the caches."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--fleets", type=int, nargs="+", default=[1, 10, 100, 500])
    parser.add_argument("--blocks", type=int, default=10, help="of 100 / blocks steps each")
    parser.add_argument("--real-time-fleet", type=int, default=100, help="0: leave this part out")
    parser.add_argument("--paper-fleet", type=int, default=10, help="0: leave the published mode out")
    parser.add_argument("--out", type=Path, default=Path("out/benchmark.json"))
    options = parser.parse_args()
    console = Console(highlight=False)
    _in_process(stages_of_fleet, 3, 10, "refined")  # compiles where that has not been done
    stages = [_in_process(stages_of_fleet, fleet, options.blocks, "refined") for fleet in options.fleets]
    if options.paper_fleet:
        stages.append(_in_process(stages_of_fleet, options.paper_fleet, options.blocks, "paper"))
    print_stages(console, stages)
    result: dict[str, Any] = {"machine": f"{platform.machine()}, {os.cpu_count()} cores", "stages": stages}
    if options.real_time_fleet:
        run = _in_process(against_real_time, options.real_time_fleet, 2, 5.0, 5)
        result["real_time"] = run
        low, high = run["real_time_factor_range"]
        console.print(
            f"{run['fleet']:.0f} equipped vehicles, 2 threads: {run['real_time_factor']:.2f} times real time "
            f"({low:.2f} to {high:.2f}; load of the machine {run['load_average']:.1f}); "
            f"{run['processor_s_per_simulated_s']:.2f} s of processor time a simulated second",
            soft_wrap=True,
        )
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=2) + "\n")
    console.print(f"written: {options.out}", soft_wrap=True)


if __name__ == "__main__":
    main()
