"""Runs that are killed at random moments (kill -9): nothing written is lost, no table is half-written.

    python benchmarks/faults.py [--kills 50] [--duration 25] [--scenario straight] [--equip 0.02]

Each round starts a run as `sumo-adas run` does, in a process forked from one that has everything loaded, with
CSV, Parquet or both, kills it at a random moment of a random step, or while it closes its tables, and reads
every table. The run notes its steps, which tells its last flush (every 10 s simulated): at least the rows up
to that must be present, complete, and equal to an undisturbed run's. A run that ends before it is killed does
not count. Exit status 1 if anything was lost.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))  # the forks know this module as benchmarks.faults

from analysis.fork_server import ForkServer
from plugin.record import read_table
from plugin.schema import TABLES

FLUSH_STEPS = 100
CLOSING_S = 0.1  # about the time to close the tables


def noted_run(out: Path, form: str, scenario: str, duration_s: float, equip: float, notes: Path) -> None:
    """A run that writes its pid, then a line after every step, to `notes`."""
    from analysis.simulate import simulate
    from plugin.assistance import DriverAssistance

    step = DriverAssistance.step
    with notes.open("w") as file:
        print(os.getpid(), file=file, flush=True)

        def told(self: DriverAssistance) -> None:
            step(self)
            print(self._steps, file=file, flush=True)

        DriverAssistance.step = told  # type: ignore[method-assign]
        formats = ("csv", "parquet") if form == "both" else (form,)
        simulate(
            scenario,
            out,
            seed=7,
            duration_s=duration_s,
            fraction=equip,
            formats=formats,
            threads=1,
            quiet=True,
        )


def noted(notes: Path) -> list[int]:
    """The process id of a run, 0 for its start, and its completed steps."""
    lines = notes.read_text().split("\n")[:-1] if notes.exists() else []
    return [int(line) for line in [*lines[:1], "0", *lines[1:]]]


def kill(running: "Future[object]", notes: Path, step: int, after_s: float) -> None:
    """Kill a run `after_s` after its step `step`."""
    while not running.done():
        so_far = noted(notes)
        if len(so_far) > 1 and so_far[-1] >= step:
            time.sleep(after_s)
            if not running.done():
                os.kill(so_far[0], signal.SIGKILL)
            return
        time.sleep(0.005)


def judge(out: Path, whole: dict[str, pd.DataFrame], flushed_steps: int) -> list[str]:
    """Faults in the tables of a killed run."""
    faults = []
    begin = float(whole["steps"]["time_s"].min())
    for name in TABLES:
        if name == "runs":
            continue  # its row is written at the end
        if not any((out / f"{name}.{end}").exists() for end in ("csv", "parquet", "parquet.parts")):
            if flushed_steps:
                faults.append(f"{name}: is not there")
            continue
        try:
            kept = read_table(out, name)
        except Exception as error:
            faults.append(f"{name}: {error}")
            continue
        wanted = whole[name].iloc[: len(kept)]
        if len(kept) and not kept.reset_index(drop=True).equals(wanted.reset_index(drop=True)):
            faults.append(f"{name}: {len(kept)} rows are not those of the undisturbed run")
        if name == "steps" and flushed_steps:
            settled = begin + flushed_steps / 10.0 - 5.2  # rows wait for the 5 s that follow them
            must = int((whole[name]["time_s"] <= settled).sum())
            if len(kept) < must:
                faults.append(f"{name}: {len(kept)} rows, {must} had been written")
    return faults


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--duration", type=float, default=25.0)
    parser.add_argument("--scenario", default="straight")
    parser.add_argument("--equip", type=float, default=0.02)
    options = parser.parse_args()
    from benchmarks.faults import noted_run as run

    draw, bad, with_rows, killed, rounds = random.Random(1), 0, 0, 0, 0
    words = (options.scenario, options.duration, options.equip)
    steps = round(10 * options.duration)
    with tempfile.TemporaryDirectory() as folder, ForkServer() as server, ThreadPoolExecutor(1) as pool:
        work = Path(folder)
        server.result(run, work / "whole", "parquet", *words, work / "notes")
        whole = {name: read_table(work / "whole", name) for name in TABLES}
        while killed < options.kills and rounds < 2 * options.kills:
            form, out = ("csv", "parquet", "both")[rounds % 3], work / f"{rounds}"
            notes, rounds = work / f"{rounds}.notes", rounds + 1
            running = pool.submit(server.call, run, out, form, *words, notes)
            step = min(draw.randint(1, steps + steps // 10), steps)  # each eleventh while it closes
            kill(running, notes, step, draw.uniform(0.0, CLOSING_S))
            if not running.result().ended_by:
                continue
            last = noted(notes)[-1] // FLUSH_STEPS * FLUSH_STEPS
            faults = judge(out, whole, last)
            with_rows += last > 0
            killed += 1
            bad += bool(faults)
            moment = f"after step {noted(notes)[-1]}, flushed at {last / 10:.0f} s"
            print(f"kill {killed} ({form}): {moment}: {'; '.join(faults) or 'nothing lost'}", flush=True)
    print(f"{killed} killed, {with_rows} of them after a flush: {bad} with something lost")
    raise SystemExit(1 if bad or killed < options.kills else 0)


if __name__ == "__main__":
    main()
