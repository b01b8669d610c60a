"""Runs that are killed at random moments (kill -9): nothing written is lost, no table is half-written.

    python benchmarks/faults.py [--kills 50] [--duration 60] [--scenario straight] [--equip 0.02]

Each round starts `sumo-adas run` with CSV, Parquet or both, kills it at a random moment and reads every table.
A thread of the killed process's own notes each flush (every 10 s simulated) on standard output, so that it is
known what had been written: at least that must be there, in whole rows, and equal to an undisturbed run's.
"""

import argparse
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

from plugin.record import read_table
from plugin.schema import TABLES

# the command, with a line after every flush
PROGRAM = """
import sys
from plugin.assistance import DriverAssistance
from analysis.cli import main
step = DriverAssistance.step
def told(self):
    step(self)
    if self._steps % 100 == 0:
        print("flushed", self._steps, flush=True)
DriverAssistance.step = told
main(sys.argv[1:])
"""


def start(out: Path, form: str, options: argparse.Namespace) -> subprocess.Popen[str]:
    """`sumo-adas run`."""
    words = ["run", options.scenario, "--out", str(out), "--format", form, "--seed", "7"]
    words += ["--duration", str(options.duration), "--equip", str(options.equip)]
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
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
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--scenario", default="straight")
    parser.add_argument("--equip", type=float, default=0.02)
    options = parser.parse_args()
    draw, bad, with_rows = random.Random(1), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        begin = time.monotonic()
        first = start(work / "whole", "parquet", options)
        first.communicate()
        took = time.monotonic() - begin
        if first.returncode != 0:
            raise SystemExit("the undisturbed run failed")
        whole = {name: read_table(work / "whole", name) for name in TABLES}
        for k in range(options.kills):
            form = ("csv", "parquet", "both")[k % 3]
            out = work / f"{k}"
            process = start(out, form, options)
            time.sleep(draw.uniform(0.0, took))
            process.send_signal(signal.SIGKILL)
            said, _ = process.communicate()
            flushes = [int(line.split()[1]) for line in said.splitlines() if line.startswith("flushed")]
            last = flushes[-1] if flushes else 0
            faults = judge(out, whole, last)
            with_rows += last > 0
            bad += bool(faults)
            kill = "ended before" if process.returncode != -signal.SIGKILL else f"killed after {last / 10:.0f} s"
            print(f"kill {k + 1} ({form}): {kill}: {'; '.join(faults) or 'nothing lost'}", flush=True)
    print(f"{options.kills} kills, {with_rows} of them after a first flush: {bad} with something lost")
    raise SystemExit(1 if bad else 0)


if __name__ == "__main__":
    main()
