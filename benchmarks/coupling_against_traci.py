"""The coupling with SUMO compared with the same loop using traci subscriptions.

    python benchmarks/coupling_against_traci.py [--steps 200] [--share 0.2] [--out out/bench/coupling.json]

Heavy traffic on the built-in highway with four lanes. A loop steps SUMO, reads position, angle, speed, lane
and lane position of all vehicles into arrays, and moves a share of them sideways in their lanes. `libsumo
getters` is this project's `Traffic`; the subscription loops are written here in the usual way: subscribe each
vehicle when it departs, get all results at once. Each runs in its own process after the same warm-up.
Measured is processor time, SUMO's process included; the bare simulationStep of libsumo without reading or
writing is subtracted to give the cost of the coupling. All loops must end with the same vehicles at the same
positions.
"""

import argparse
import functools
import math
import multiprocessing
import subprocess
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from side_by_side import report

HEAVY = {"demand": {"flow_per_lane_vph": 2200.0, "truck": {"share": 0.05}}, "highway": {"lanes": 4}}
FILL_STEPS, WARM_UP_STEPS = 600, 20


class Read(NamedTuple):
    """All vehicles after a step, ordered by name."""

    names: list[str]
    numbers: np.ndarray  # (n, 5): x, y, angle, speed, along
    lanes: list[str]


@functools.cache
def is_put(name: str, share: float) -> bool:
    """Whether a vehicle is one of those moved sideways."""
    return (hash_of(name) % 1000) < 1000 * share


@functools.cache
def hash_of(name: str) -> int:
    """Hash that is the same in every process."""
    return sum((k + 1) * ord(letter) for k, letter in enumerate(name)) * 7919


def across(name: str, step: int) -> float:
    """Lateral position in its lane, m left."""
    return 0.3 * math.sin(0.05 * step + hash_of(name))


def by_subscription(sumo: Any, constants: Any) -> Callable[[], Read]:
    """Read by subscriptions, as in traci's manual."""
    tc = constants
    variables = (
        tc.VAR_POSITION,
        tc.VAR_ANGLE,
        tc.VAR_SPEED,
        tc.VAR_LANEPOSITION,
        tc.VAR_LANE_ID,
    )
    known: set[str] = set()

    def read() -> Read:
        for name in sumo.simulation.getDepartedIDList() if known else sumo.vehicle.getIDList():
            if name not in known:
                sumo.vehicle.subscribe(name, variables)
                known.add(name)
        results = sumo.vehicle.getAllSubscriptionResults()
        names = sorted(results)
        rows = [results[name] for name in names]
        numbers = np.array([(*row[variables[0]], *(row[v] for v in variables[1:4])) for row in rows])
        return Read(names, numbers, [row[variables[4]] for row in rows])

    return read


def loop(kind: str, steps: int, share: float, seed: int) -> dict[str, Any]:
    """Seconds per step of one kind of loop, and the vehicles' final positions."""
    import psutil
    import traci.constants

    from plugin.configuration import load_configuration
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

    configuration = load_configuration("highway", {**HEAVY, "duration_s": 3600.0, "seed": seed})
    with tempfile.TemporaryDirectory() as work:
        words = prepare(configuration, Path(work)).arguments
        if kind == "traci subscriptions":
            import sumolib
            import traci

            from sumo_net.start_up import set_sumo_home

            set_sumo_home()
            traci.start([sumolib.checkBinary("sumo"), *words], stdout=subprocess.DEVNULL)
            sumo: Any = traci
        else:
            import libsumo

            from sumo_net.start_up import set_sumo_home

            set_sumo_home()
            libsumo.start(["sumo", *words])
            sumo = libsumo
        children = psutil.Process().children(recursive=True)

        def spent() -> float:
            others = [child.cpu_times() for child in children]
            return time.process_time() + sum(other.user + other.system for other in others)

        for _ in range(FILL_STEPS):
            sumo.simulationStep()
        traffic = Traffic.attach(sumo) if kind == "libsumo getters" else None
        read = by_subscription(sumo, traci.constants) if "subscriptions" in kind else None
        vehicles = []
        begin = spent()
        for step in range(-WARM_UP_STEPS, steps):
            if step == 0:
                begin = spent()
            sumo.simulationStep()
            if traffic is not None:
                snapshot = traffic.snapshot()
                names = [traffic.vehicle_id(handle) for handle in snapshot.handle.tolist()]
                put = [k for k, name in enumerate(names) if is_put(name, share)]
                where = np.array([across(names[k], step) for k in put])
                traffic.write_lateral(snapshot.handle[put], where)
                vehicles.append(len(names))
            elif read is not None:
                seen = read()
                for name in seen.names:
                    if is_put(name, share):
                        sumo.vehicle.setLateralLanePosition(name, across(name, step))
                vehicles.append(len(seen.names))
            elif kind == "chosen and computed":
                for name in sumo.vehicle.getIDList():
                    if is_put(name, share):
                        across(name, step)
        total = spent() - begin
        names = sorted(sumo.vehicle.getIDList())
        end = [(name, *sumo.vehicle.getPosition(name), sumo.vehicle.getSpeed(name)) for name in names]
        sumo.close()
    return {"seconds": total / steps, "vehicles": float(np.mean(vehicles or [len(names)])), "end": end}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--share", type=float, default=0.2)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/bench/coupling.json"))
    options = parser.parse_args()
    kinds = (
        "bare simulationStep",
        "chosen and computed",
        "libsumo getters",
        "libsumo subscriptions",
        "traci subscriptions",
    )
    context = multiprocessing.get_context("spawn")  # one SUMO per process
    done: dict[str, list[dict[str, Any]]] = {kind: [] for kind in kinds}
    for _ in range(options.repeats):
        for kind in kinds:
            with ProcessPoolExecutor(1, context) as pool:
                done[kind].append(pool.submit(loop, kind, options.steps, options.share, 7).result())
    median = {kind: float(np.median([one["seconds"] for one in done[kind]])) for kind in kinds}
    alike = [done[kind][0]["end"] == done["libsumo getters"][0]["end"] for kind in kinds[2:]]
    assert all(alike), "the loops did not end with the same vehicles in the same places"
    vehicles = done["libsumo getters"][0]["vehicles"]
    own = {kind: median[kind] - median["chosen and computed"] for kind in kinds[2:]}
    rows = [
        {
            "loop": kind,
            "ms a step": 1e3 * median[kind],
            "coupling alone, ms": 1e3 * own[kind] if kind in own else 0.0,
            "us a vehicle": 1e6 * own[kind] / vehicles if kind in own else 0.0,
            "times ours": own[kind] / own["libsumo getters"] if kind in own else 0.0,
        }
        for kind in kinds
    ]
    note = (
        f"{vehicles:.0f} vehicles, {options.share:.0%} put sideways, {options.steps} steps, medians of "
        f"{options.repeats}; all loops ended with the same vehicles in the same places. 'chosen and "
        "computed' is the bare step and this file's own choice and sines, which the others pay too"
    )
    report("Coupling with SUMO", rows, options.out, ("eclipse-sumo", "libsumo", "traci"), note)


if __name__ == "__main__":
    main()
