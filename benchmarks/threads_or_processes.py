"""Using all cores by threads within a run or by concurrent runs: the same runs both ways, wall-clock time.

    python benchmarks/threads_or_processes.py [--runs 4] [--duration 20] [--equip 0.05 0.2 0.5]

For every equipped share: all runs one after the other with one thread per core, and one run per core at a
time with one thread each, forked from one process that has everything loaded, as a campaign's runs are. The
tables of both are compared byte for byte. Columns: vehicle-steps; wall-clock seconds; the gain of the
processes.
"""

import argparse
import filecmp
import os
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # the forks know this module as benchmarks.…

from analysis.fork_server import ForkServer
from analysis.simulate import simulate
from plugin.record import read_table


def drive(seed: int, out: Path, duration_s: float, fraction: float, threads: int) -> None:
    """One run of the default scenario."""
    simulate(
        "highway", out, seed=seed, duration_s=duration_s, fraction=fraction, formats=("parquet",),
        threads=threads, quiet=True,
    )  # fmt: skip


def timed(server: ForkServer, runs: int, at_once: int, folder: Path, *rest: Any) -> float:
    """Wall-clock seconds of all runs, `at_once` of them at a time; the tables go into `folder`."""
    from benchmarks.threads_or_processes import drive as job  # by the name that the forks can import

    begin = time.perf_counter()
    with ThreadPoolExecutor(at_once) as pool:
        list(pool.map(lambda k: server.result(job, 600 + k, folder / str(k), *rest), range(runs)))
    return time.perf_counter() - begin


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--duration", type=float, default=20.0)
    parser.add_argument("--equip", type=float, nargs="+", default=[0.05, 0.2, 0.5])
    options = parser.parse_args()
    cores = os.cpu_count() or 1
    print(f"{cores} cores, {options.runs} runs of {options.duration:g} s\n")
    print("| equipped | vehicle-steps | threads, s | processes, s | gain |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, ForkServer() as server:
        drive_once = (1.0, 0.1, 1)
        timed(server, 1, 1, Path(folder) / "first", *drive_once)  # loads everything that a run needs
        for share in options.equip:
            threads, processes = (Path(folder) / f"{kind}{share}" for kind in ("threads", "processes"))
            one = timed(server, options.runs, 1, threads, options.duration, share, cores)
            other = timed(server, options.runs, cores, processes, options.duration, share, 1)
            steps = 0
            for k in range(options.runs):
                names = [path.name for path in (threads / str(k)).glob("*.parquet")]
                _, differing, missing = filecmp.cmpfiles(
                    threads / str(k), processes / str(k), names, shallow=False
                )
                if differing or missing or "steps.parquet" not in names:
                    raise SystemExit(f"run {k}: of {names} {differing + missing} differ with other threads")
                steps += len(read_table(threads / str(k), "steps"))
            print(f"| {share:g} | {steps} | {one:.1f} | {other:.1f} | {one / other:.2f} |", flush=True)


if __name__ == "__main__":
    main()
