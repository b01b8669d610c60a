"""Campaigns: two workers against one, and a campaign that is killed again and again.

    python benchmarks/campaign.py scaling [--runs 6] [--duration 60]
    python benchmarks/campaign.py kill [--kills 20] [--runs 12]

`kill` sends SIGKILL to the whole campaign (client, workers, runs) at random moments, resumes it with the same
command, and at the end compares every CSV of the report with that of a campaign that nobody disturbed.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMMAND = [sys.executable, "-c", "from analysis.cli import main; main()", "batch"]
FILE = """title = "Benchmark"
scenarios = ["{scenario}"]
seeds = {{ first = 500, count = {runs} }}
duration_s = {duration}
settings = {{ "equipment.fraction" = {fraction} }}
"""


def start(file: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    """The command, in a process group of its own."""
    words = [*COMMAND, str(file), "--out", str(out), "--workers", str(workers)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(words, stdout=quiet, stderr=quiet, start_new_session=True)


def timed(file: Path, out: Path, workers: int) -> float:
    """Seconds on the clock of a whole campaign."""
    begin = time.perf_counter()
    if start(file, out, workers).wait() != 0:
        raise SystemExit(f"the campaign in {out} failed")
    return time.perf_counter() - begin


def scaling(work: Path, runs: int, duration_s: float) -> None:
    """One worker, then two."""
    file = work / "campaign.toml"
    file.write_text(FILE.format(scenario="highway", runs=runs, duration=duration_s, fraction=0.1))
    one, two = timed(file, work / "one", 1), timed(file, work / "two", 2)
    gain = one / two
    print(
        f"{runs} runs of {duration_s:g} s: one worker {one:.1f} s, two {two:.1f} s: {gain:.2f} times as fast"
    )
    print(f"core seconds a run: {one / runs:.1f}")


def kill(work: Path, kills: int, runs: int) -> None:
    """Kill it, resume it; whole again at the end."""
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
    parser.add_argument("what", choices=("scaling", "kill"))
    parser.add_argument("--runs", type=int)
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--kills", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.what == "scaling":
            scaling(Path(folder), options.runs or 6, options.duration)
        else:
            kill(Path(folder), options.kills, options.runs or 12)


if __name__ == "__main__":
    main()
