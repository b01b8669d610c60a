"""Soak test: a long run with arrivals and departures throughout; follows memory and the sizes of all state.

    python benchmarks/soak.py [--duration 3600] [--equip 0.36] [--flow 450] [--out out/soak]

The road is full from the start, and the flow is a quarter of the lanes' capacity, so no queue builds up: the
fleet keeps its steady size of about 50, and a vehicle stays for about three minutes.

Every 30 s simulated a row is written to OUT/soak.csv, also kept if interrupted: resident memory, vehicles,
processor time, and the entries in the containers of the assistance and the traffic. At the end, or at Ctrl-C:
the slope of memory after the first quarter, as measured and corrected for the fleet's peak so far (`slope`),
and every container that grew throughout. Exit status 1 if the corrected memory rises by more than 5 MB per
hour beyond twice its standard error, or is above 1 GB, or a container grew that is not in KNOWN.
"""

import argparse
import csv
import math
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil

OURS = ("sumo_net", "plugin", "camera_synth", "radar_synth")
EVERY_STEPS = 300
MOST_MB, MOST_MB_PER_H = 1000.0, 5.0
WARM_UP = 0.25  # of the samples
# May grow with the number of vehicles ever seen: arrays by handle (together under 100 bytes per vehicle), the
# network's roads, and keys of random draws.
KNOWN = (
    "_equipped", "_bodies", "_lane", "_left", "_from_m", "_row", "_keys", "_store", "_by_lanes", "_by_route",
    "_errors", "_chains", "_lanes", "_ahead", "_number", "_sections", "table",
)  # fmt: skip


def sizes(root: Any, name: str) -> dict[str, int]:
    """Entries of every dict, list, set, deque and array reachable from this project's objects, by path."""
    found: dict[str, int] = {}
    seen: set[int] = set()
    waiting: list[tuple[str, Any]] = [(name, root)]
    while waiting:
        path, one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            found[path] = len(one) if one.ndim else 0
        elif isinstance(one, dict | list | set | deque):
            found[path] = len(one)
            values = list(one.values()) if isinstance(one, dict) else list(one)
            waiting += [(f"{path}[]", value) for value in values[:1] if _is_ours(value)]
        elif _is_ours(one):
            waiting += [(f"{path}.{key}", value) for key, value in _attributes(one)]
    return found


def _is_ours(one: Any) -> bool:
    return type(one).__module__.split(".")[0] in OURS


def _attributes(one: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(one, tuple):
        yield from getattr(one, "_asdict", dict)().items()
    yield from getattr(one, "__dict__", {}).items()
    for kind in type(one).__mro__:
        for slot in getattr(kind, "__slots__", ()):
            if hasattr(one, slot):
                yield slot, getattr(one, slot)


def slope(hours: np.ndarray, values: np.ndarray, *beside: np.ndarray) -> tuple[float, float]:
    """Slope of `values` per simulated hour by least squares, and its standard error.

    `beside`: (N,) each, further regressors such as the largest fleet so far, whose effect is removed. A
    column that is constant or collinear with others has no effect.
    """
    x = hours - hours.mean()
    y = values - values.mean()
    if beside:
        others = np.stack(beside, axis=1) - np.mean(beside, axis=1)
        x, y = (one - others @ np.linalg.lstsq(others, one, rcond=None)[0] for one in (x, y))
    rise = float((x * y).sum() / (x * x).sum())
    rest = y - rise * x
    free = max(len(x) - 2 - len(beside), 1)
    return rise, math.sqrt(float((rest * rest).sum()) / free / float((x * x).sum()))


def soak(duration_s: float, equip: float, flow_vph: float, out: Path, scenario: str, threads: int) -> int:
    """Run it; returns the exit status."""
    from analysis.simulate import settings_of
    from plugin import DriverAssistance
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

    changes = {"demand": {"flow_per_lane_vph": flow_vph}}
    configuration = settings_of(scenario, duration_s=duration_s, fraction=equip, seed=1, changes=changes)
    out.mkdir(parents=True, exist_ok=True)
    process, samples, states = psutil.Process(), [], []
    with (
        tempfile.TemporaryDirectory() as work,
        (out / "soak.csv").open("w", newline="") as file,
    ):
        prepared = prepare(configuration, Path(work))
        rows = csv.writer(file)
        rows.writerow(["time_s", "rss_mb", "cpu_s", "equipped", "vehicles", "seen", "entries"])
        with (
            Traffic.start(prepared.arguments) as traffic,
            DriverAssistance(
                traffic, configuration, prepared.network, out=out, formats=("parquet",), threads=threads
            ) as adas,
        ):
            for _ in range(prepared.warm_up_steps):
                traffic.step()
            for step in range(1, prepared.recorded_steps + 1):
                try:
                    traffic.step()
                    adas.step()
                except KeyboardInterrupt:
                    break
                if step % EVERY_STEPS == 0:
                    state = sizes(adas, "adas") | sizes(traffic, "traffic")
                    seen = int(adas._last_handle) + 1
                    sample = (
                        step / 10,
                        process.memory_info().rss / 2**20,
                        time.process_time(),
                        len(adas.vehicles),
                        len(traffic._numbers),
                        seen,
                        sum(state.values()),
                    )
                    samples.append(sample)
                    states.append(state)
                    rows.writerow([f"{value:.1f}" if isinstance(value, float) else value for value in sample])
                    file.flush()
    return judge(np.array(samples, dtype=float), states)


def judge(samples: np.ndarray, states: list[dict[str, int]]) -> int:
    """Print the results; returns the exit status."""
    first = int(WARM_UP * len(samples))
    later, peaks = samples[first:], np.maximum.accumulate(samples[:, 3:5])[first:]
    hours, memory_mb = later[:, 0] / 3600.0, later[:, 1]
    plain, plain_error = slope(hours, memory_mb)
    rise, error = slope(hours, memory_mb, *peaks.T)
    print(
        f"{samples[-1, 0]:.0f} s simulated, "
        f"{later[:, 3].mean():.0f} equipped of {later[:, 4].mean():.0f} vehicles"
    )
    print(f"{samples[-1, 5]:.0f} vehicles seen, {samples[-1, 2] / 60:.1f} core-minutes")
    print(f"fleet per hour {' '.join(f'{slope(hours, column)[0]:+.1f}' for column in later[:, 3:5].T)}")
    print(f"memory {memory_mb[0]:.0f} to {memory_mb[-1]:.0f} MB, at most {samples[:, 1].max():.0f}")
    print(f"slope after {later[0, 0]:.0f} s: {plain:+.2f} ± {2 * plain_error:.2f} MB per simulated hour")
    print(f"corrected for the fleet's peak: {rise:+.2f} ± {2 * error:.2f} MB per simulated hour")
    grown = sorted(grew(states[first:]))
    unknown = [name for name in grown if not any(f".{known}" in name for known in KNOWN)]
    print(f"containers that grew steadily: {', '.join(grown) or 'none'}")
    print(f"of these not known: {', '.join(unknown) or 'none'}")
    leaks = rise - 2.0 * error > MOST_MB_PER_H or samples[:, 1].max() > MOST_MB or bool(unknown)
    return 1 if leaks else 0


def grew(states: list[dict[str, int]]) -> set[str]:
    """Containers that are larger in every quarter of the samples than in the one before."""
    names = set.intersection(*(set(state) for state in states)) if states else set()
    found = set()
    for name in names:
        values = np.array([state[name] for state in states])
        parts = [part.min() for part in np.array_split(values, 4) if len(part)]
        tops = [part.max() for part in np.array_split(values, 4) if len(part)]
        if len(parts) == 4 and all(parts[k + 1] > tops[k] for k in range(3)):
            found.add(name)
    return found


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--duration", type=float, default=3600.0)
    parser.add_argument("--equip", type=float, default=0.36)
    parser.add_argument("--flow", type=float, default=450.0, help="vehicles per hour and lane")
    parser.add_argument("--scenario", default="highway")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/soak"))
    options = parser.parse_args()
    raise SystemExit(
        soak(options.duration, options.equip, options.flow, options.out, options.scenario, options.threads)
    )


if __name__ == "__main__":
    main()
