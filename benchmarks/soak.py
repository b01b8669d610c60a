"""Soak: a long run with arrivals and departures throughout; memory, and the sizes of all state, as it goes.

    python benchmarks/soak.py [--duration 3600] [--equip 0.2] [--out out/soak]

Every 30 s simulated a row goes to OUT/soak.csv (so an interrupted soak leaves what it has): resident
memory, vehicles, processor time, and the entries in the containers of the assistance and the traffic. At the
end, or at Ctrl-C: the slope of memory over the second half, and every container that grew throughout it. Exit
status 1 where memory rises by more than 2 MB an hour beyond twice its standard error, or is above 1 GB, or a
container grew that is not in KNOWN.
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
MOST_MB, MOST_MB_PER_H = 1000.0, 2.0
# What may grow with the vehicles ever seen: arrays by handle (together under 100 bytes a vehicle), the roads
# that a network has, and the draws' keys.
KNOWN = (
    "_equipped", "_bodies", "_lane", "_left", "_from_m", "_row", "_keys", "_store", "_by_lanes", "_by_route",
    "_errors", "_chains", "_lanes", "_ahead", "_number", "_sections", "table",
)  # fmt: skip


def sizes(root: Any, name: str) -> dict[str, int]:
    """Entries of every dict, list, set, deque and array that objects of this project reach, by path."""
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


def slope(hours: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Of the least-squares line, a simulated hour, and its standard error."""
    x = hours - hours.mean()
    rise = float((x * values).sum() / (x * x).sum())
    rest = values - values.mean() - rise * x
    return rise, math.sqrt(float((rest * rest).sum()) / max(len(x) - 2, 1) / float((x * x).sum()))


def soak(duration_s: float, equip: float, out: Path, scenario: str, threads: int) -> int:
    """Run it; the exit status."""
    from analysis.simulate import settings_of
    from plugin import DriverAssistance
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic

    configuration = settings_of(scenario, duration_s=duration_s, fraction=equip, seed=1)
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
    """Print what came of it; the exit status."""
    half = len(samples) // 2
    later = samples[half:]
    rise, error = slope(later[:, 0] / 3600.0, later[:, 1])
    print(
        f"{samples[-1, 0]:.0f} s simulated, "
        f"{later[:, 3].mean():.0f} equipped of {later[:, 4].mean():.0f} vehicles"
    )
    print(f"{samples[-1, 5]:.0f} vehicles seen, {samples[-1, 2] / 60:.1f} core-minutes")
    print(f"memory {later[0, 1]:.0f} to {later[-1, 1]:.0f} MB, at most {samples[:, 1].max():.0f}")
    print(f"slope of the second half {rise:+.2f} ± {2 * error:.2f} MB a simulated hour")
    grown = sorted(grew(states[half:]))
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
    parser.add_argument("--equip", type=float, default=0.2)
    parser.add_argument("--scenario", default="highway")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/soak"))
    options = parser.parse_args()
    raise SystemExit(soak(options.duration, options.equip, options.out, options.scenario, options.threads))


if __name__ == "__main__":
    main()
