"""Campaigns: one and two workers, many short runs, and a campaign that is killed repeatedly.

    python benchmarks/campaign.py scaling [--runs 6] [--duration 60]
    python benchmarks/campaign.py many [--runs 1000] [--duration 1] [--workers 2]
    python benchmarks/campaign.py engine [--runs 3000] [--workers 2]
    python benchmarks/campaign.py start [--runs 8]
    python benchmarks/campaign.py kill [--kills 20] [--runs 300]

`scaling` prints the gain in wall-clock time and, for a shared machine, its two components: the processor time
of the runs with one and with two workers, and the share of the workers' time spent in runs. `many` follows
the resident memory of the client (which contains scheduler and workers of a local campaign) and of the server
that runs are forked from. `engine` does the same with empty runs, to measure the engine's processor time and
memory. `start` times runs of 0.1 s in new processes and in forks. `kill` sends SIGKILL to the whole campaign
(client, workers, runs) at random times, resumes it with the same command, and at the end compares every CSV
of the report with that of an undisturbed campaign.
"""

import argparse
import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

sys.path.insert(0, str(Path(__file__).parents[1]))  # the forks know this module as benchmarks.campaign

COMMAND = [sys.executable, "-c", "from analysis.cli import main; main()", "batch"]
FILE = """title = "Benchmark"
scenarios = ["{scenario}"]
seeds = {{ first = 500, count = {runs} }}
duration_s = {duration}
settings = {{ "equipment.fraction" = {fraction} }}
"""


def start(file: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    """Start the command in its own process group."""
    words = [*COMMAND, str(file), "--out", str(out), "--workers", str(workers)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(words, stdout=quiet, stderr=quiet, start_new_session=True)


def timed(file: Path, out: Path, workers: int) -> float:
    """Wall-clock seconds of a whole campaign."""
    begin = time.perf_counter()
    if start(file, out, workers).wait() != 0:
        raise SystemExit(f"the campaign in {out} failed")
    return time.perf_counter() - begin


class Watch:
    """Follows a campaign that runs in this process."""

    def __init__(self, every: int = 0, file: Path | None = None) -> None:
        self.begin = time.perf_counter()
        self.ready = float("nan")  # time at which the cluster is ready
        self.done: list[Any] = []
        self.memory: list[tuple[int, float, float, float]] = []  # runs, MB of client and server, own CPU
        self._every, self._file = every, file

    def __call__(self, progress: Any) -> None:
        if progress.last is None:
            self.ready = time.perf_counter()
            return
        self.done.append(progress.last)
        if self._every and len(self.done) % self._every == 0:
            from analysis.campaign.engine import _server

            server = psutil.Process(_server.pid)
            row = (len(self.done), rss_mb(psutil.Process()), rss_mb(server), time.process_time())
            self.memory.append(row)
            print(
                f"{row[0]} runs: client {row[1]:.1f} MB, server {row[2]:.1f} MB, client's processor "
                f"{row[3]:.1f} s",
                flush=True,
            )
            if self._file is not None:
                with self._file.open("a", newline="") as file:
                    csv.writer(file).writerow(row)


def rss_mb(process: psutil.Process) -> float:
    """Resident memory."""
    return float(process.memory_info().rss / 2**20)


def watched(file: Path, out: Path, workers: int, watch: Watch) -> float:
    """Wall-clock seconds of a campaign in this process, the cluster's start included."""
    from analysis.campaign import load, run

    plan = load(file)
    watch.begin = time.perf_counter()
    failures = run(plan, out, workers=workers, tell=watch)
    seconds = time.perf_counter() - watch.begin
    if failures:
        raise SystemExit(f"failed: {failures}")
    return seconds


def scaling(work: Path, runs: int, duration_s: float) -> None:
    """One worker, then two."""
    file = work / "campaign.toml"
    file.write_text(FILE.format(scenario="highway", runs=runs, duration=duration_s, fraction=0.1))
    clock, cpu = {}, {}
    for workers in (1, 2):
        watch, before = Watch(), time.process_time()
        clock[workers] = watched(file, work / f"{workers}", workers, watch)
        own = time.process_time() - before
        inside = sum(done.run_s for done in watch.done)
        cpu[workers] = sum(done.cpu_s for done in watch.done)
        outside = sum(done.seconds - done.run_s for done in watch.done[workers:])
        steady = sum(done.seconds for done in watch.done[workers:])
        print(
            f"{workers} workers: {clock[workers]:.1f} s, {cpu[workers] / runs:.2f} core seconds per run; "
            f"cluster started in {watch.ready - watch.begin:.2f} s\n  in runs "
            f"{inside / workers / clock[workers]:.1%} of the workers' time; what a worker does around a run "
            f"{outside / steady:.2%} of it (without the first of each)\n  client, scheduler and "
            f"workers took {own:.2f} s of processor time, "
            f"{own / cpu[workers]:.2%} of the runs'; load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
    print(f"two workers {clock[1] / clock[2]:.2f} times as fast by the clock")


def many(work: Path, runs: int, duration_s: float, workers: int) -> None:
    """Memory over many short runs."""
    file, watch = work / "campaign.toml", Watch(every=max(runs // 20, 1))
    text = FILE.format(scenario="straight", runs=runs, duration=duration_s, fraction=0.02)
    file.write_text(text.replace("settings = { ", "settings = { warm_up_s = 0.0, "))
    seconds = watched(file, work / "out", workers, watch)
    cpu = sum(done.cpu_s for done in watch.done)
    own = time.process_time()
    print(f"{runs} runs in {seconds:.0f} s, {cpu / runs:.2f} core seconds each, client {own:.1f} s")


def nothing(order: dict[str, Any], place: Path) -> None:
    """Replaces a run: writes a result without simulating."""
    place.mkdir()
    counts = {"runs": 1, "distance_mm": order["seed"], "vehicle_steps": 1, "vehicles": 1}
    summary = {"key": order["key"], "cell": order["cell"], "seed": order["seed"], "counts": counts}
    (place / "summary.json").write_text(json.dumps(summary))


def engine_alone(work: Path, runs: int, workers: int) -> None:
    """The engine without runs: planning, scheduling, forking, storing."""
    from analysis.campaign import engine
    from benchmarks.campaign import nothing as known_by_the_forks

    engine.one_run = known_by_the_forks
    server: list[float] = []

    class WithServer(Watch):
        def __call__(self, progress: Any) -> None:
            super().__call__(progress)
            if progress.last is not None and len(self.done) == runs:
                times = psutil.Process(engine._server.pid).cpu_times()
                server.append(times.user + times.system)

    file, watch = work / "campaign.toml", WithServer(every=max(runs // 10, 1))
    file.write_text(FILE.format(scenario="straight", runs=runs, duration=1.0, fraction=0.02))
    from analysis.campaign import load

    load(file)  # imports
    before = time.process_time()
    seconds = watched(file, work / "out", workers, watch)
    own = (time.process_time() - before) / runs
    forks = sum(done.cpu_s for done in watch.done) / runs
    print(
        f"{runs} runs in {seconds:.0f} s; a run costs {1e3 * own:.1f} ms of processor time in client, "
        f"scheduler and worker, {1e3 * forks:.1f} ms in its fork; the server took {server[0]:.1f} s in all"
    )


def start_up(work: Path, runs: int) -> None:
    """Runs of 0.1 s in new processes and in forks of one that has everything loaded."""
    from analysis.fork_server import ForkServer

    order = {
        "key": "k", "cell": 0, "scenario": "highway", "seed": 1, "keep": [], "compare_paper": False,
        "changes": {"duration_s": 0.1, "warm_up_s": 0.0},
    }  # fmt: skip
    code = "import sys; from pathlib import Path; from analysis.campaign.one import one; "
    took: dict[str, list[float]] = {"fresh": [], "fork": []}
    with ForkServer() as server:
        from analysis.campaign.one import one

        server.call(one, order, work / "first")
        for k in range(runs):  # interleaved, so that other load affects both
            before = os.times()
            program = f"{code}one({order!r}, Path({str(work / f'fresh{k}')!r}))"
            subprocess.run([sys.executable, "-c", program], check=True)
            after = os.times()
            cpu = after.children_user + after.children_system - before.children_user - before.children_system
            took["fresh"].append(cpu)
            took["fork"].append(server.call(one, order, work / f"fork{k}").cpu_s)
    for name, values in took.items():
        print(f"{name}: {sorted(values)[len(values) // 2]:.2f} core seconds per run (median of {runs})")


def kill(work: Path, kills: int, runs: int) -> None:
    """Kill and resume it repeatedly; complete at the end."""
    file, draw = work / "campaign.toml", random.Random(1)
    file.write_text(FILE.format(scenario="straight", runs=runs, duration=2.0, fraction=0.05))
    timed(file, work / "whole", 2)
    done = 0
    for k in range(kills):
        process = start(file, work / "broken", 2)
        time.sleep(draw.uniform(0.5, 9.0))
        finished = process.poll() is not None
        if not finished:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        done = len(list((work / "broken").glob("runs/*/summary.json")))
        print(f"kill {k + 1}: {done} of {runs} runs there{' (had finished)' if finished else ''}")
    timed(file, work / "broken", 2)
    names = sorted(path.name for path in (work / "whole").glob("*.csv"))
    same = [(work / "whole" / n).read_bytes() == (work / "broken" / n).read_bytes() for n in names]
    print(f"{sum(same)} of {len(names)} files of the report are the same, byte for byte")
    raise SystemExit(0 if all(same) else 1)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("scaling", "many", "engine", "start", "kill"))
    parser.add_argument("--runs", type=int)
    parser.add_argument("--duration", type=float)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kills", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.what == "scaling":
            scaling(Path(folder), options.runs or 6, options.duration or 60.0)
        elif options.what == "many":
            many(Path(folder), options.runs or 1000, options.duration or 1.0, options.workers)
        elif options.what == "engine":
            engine_alone(Path(folder), options.runs or 3000, options.workers)
        elif options.what == "start":
            start_up(Path(folder), options.runs or 8)
        else:
            kill(Path(folder), options.kills, options.runs or 300)


if __name__ == "__main__":
    main()
