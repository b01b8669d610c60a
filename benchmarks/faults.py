"""Runs that are killed at random moments (kill -9): nothing written is lost, no table is half-written.

    python benchmarks/faults.py [--kills 50] [--duration 25] [--scenario straight] [--equip 0.02]

Each round starts what `sumo-adas run` does, in a process forked from one that has everything loaded, with
CSV, Parquet or both, kills it at a random moment and reads every table. The run notes each flush (every 10 s
simulated), so that it is known what had been written: at least that must be there, in whole rows, and equal
to an undisturbed run's.
"""

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))  # the forks know this module as benchmarks.faults

from analysis.fork_server import ForkServer
from plugin.record import read_table
from plugin.schema import TABLES


def noted_run(out: Path, form: str, scenario: str, duration_s: float, equip: float, notes: Path) -> None:
    """A run that writes its pid, and a line after every flush, to `notes`."""
    from analysis.simulate import simulate
    from plugin.assistance import DriverAssistance

    step = DriverAssistance.step
    with notes.open("w") as file:
        print(os.getpid(), file=file, flush=True)

        def told(self: DriverAssistance) -> None:
            step(self)
            if self._steps % 100 == 0:
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


def judge(out: Path, whole: dict[str, pd.DataFrame], flushed_steps: int) -> list[str]:
    """What is wrong with the tables of a killed run."""
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
            settled = begin + flushed_steps / 10.0 - 5.2  # rows wait until 5 s after them are known
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

    draw, bad, with_rows, killed = random.Random(1), 0, 0, 0
    words = (options.scenario, options.duration, options.equip)
    with tempfile.TemporaryDirectory() as folder, ForkServer() as server, ThreadPoolExecutor(1) as pool:
        work = Path(folder)
        server.result(run, work / "first", "csv", *words, work / "notes")
        begin = time.monotonic()
        server.result(run, work / "whole", "parquet", *words, work / "notes")
        took = time.monotonic() - begin
        whole = {name: read_table(work / "whole", name) for name in TABLES}
        for k in range(options.kills):
            form, out, notes = ("csv", "parquet", "both")[k % 3], work / f"{k}", work / f"{k}.notes"
            running = pool.submit(server.call, run, out, form, *words, notes)
            while not (notes.exists() and notes.read_text().endswith("\n")):
                time.sleep(0.01)
            time.sleep(draw.uniform(0.0, took))
            if not running.done():
                os.kill(int(notes.read_text().split()[0]), signal.SIGKILL)
            ended_by = running.result().ended_by
            flushes = [int(line) for line in notes.read_text().split()[1:]]
            last = flushes[-1] if flushes else 0
            faults = judge(out, whole, last)
            with_rows += last > 0 and ended_by > 0
            killed += ended_by > 0
            bad += bool(faults)
            kill = f"killed after the flush at {last / 10:.0f} s" if ended_by else "had ended"
            print(f"kill {k + 1} ({form}): {kill}: {'; '.join(faults) or 'nothing lost'}", flush=True)
    print(
        f"{options.kills} rounds, {killed} killed, "
        f"{with_rows} of them after a flush: {bad} with something lost"
    )
    raise SystemExit(1 if bad else 0)


if __name__ == "__main__":
    main()
