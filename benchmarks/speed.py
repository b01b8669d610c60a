"""Cost of an equipped vehicle: by stage and fleet size, in memory, and at start-up.

    python benchmarks/speed.py [--fleets 1 10 100 500 1000] [--steps 100] [--out out/benchmark.json]
                               [--cold] [--record "what has changed"]

Each fleet drives in its own process on the built-in highway in heavy traffic, four lanes per direction (six
if the fleet needs them), so that all cameras see about the same. Stages are timed in processor time on one
thread (other programs matter only through shared caches and hyper-threads); given is the median over ten
blocks of steps. Everything is written as JSON; `--record` also appends the main figures to
benchmarks/history.json, which holds those of other versions.
"""

import argparse
import json
import multiprocessing
import os
import platform
import subprocess
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from machine import limits
from rich.console import Console
from rich.table import Table
from stages import CHAIN, RADAR, STAGES, against_real_time, search_by_frame, stages_of_fleet
from start_up import start_up

HISTORY = Path(__file__).with_name("history.json")
WANTED_OWN_MS, WANTED_LATER_MS = 0.4, 0.25
WIDTH = 120  # of the table; rich would cut figures where the output is a file or a narrow terminal


def _in_process(function: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def print_stages(console: Console, results: list[dict[str, Any]]) -> None:
    """Print one column per fleet."""
    console.print("ms of processor time per vehicle-step, one thread, by number of equipped vehicles")
    table = Table(box=None)
    table.add_column("stage", no_wrap=True)
    for result in results:
        table.add_column(f"{result['fleet']:.0f}", justify="right")
    for name in STAGES:
        mark = "" if name in CHAIN else "  " if name in RADAR else "    "
        table.add_row(mark + name, *(f"{result['stages_ms'][name]:.4f}" for result in results))
    for title, key in (
        ("camera chain", "camera_ms"),
        ("radar chain", "radar_ms"),
        (f"whole step but SUMO and its reading (wanted {WANTED_OWN_MS})", "own_ms"),
        ("whole step", "whole_step_ms"),
        ("  lowest block", "whole_step_lowest_ms"),
    ):
        table.add_row(title, *(f"{result[key]:.3f}" for result in results))
    for title, key in (
        ("SUMO, ms per step", "sumo_ms_per_step"),
        ("reading its state, ms per step", "read_ms_per_step"),
        ("vehicles in the traffic", "vehicles_in_traffic"),
        ("resident, MB", "resident_mb"),
        ("  of that since the fleet came, MB", "fleet_mb"),
    ):
        table.add_row(title, *(f"{result[key]:.1f}" for result in results))
    console.print(table)


def print_rest(console: Console, result: dict[str, Any]) -> None:
    """Print the other figures, one line each."""
    search = result["published_search_ms"]
    console.print(
        f"published search, ms for both borders: {search['first']:.2f} in frame 1, "
        f"{search['second to sixth']:.2f} in frames 2 to 6, {search['later']:.3f} later "
        f"(wanted {WANTED_LATER_MS})"
    )
    for run in result["real_time"]:
        console.print(
            f"{run['fleet']:.0f} equipped, {run['threads']} threads: {run['real_time_factor']:.2f} times "
            f"real time at a load of {run['load_average']:.1f}; "
            f"{run['processor_s_per_simulated_s']:.2f} s of processor time per simulated second",
            soft_wrap=True,
        )
    for name, start in result["start_up"].items():
        console.print(
            f"first step after {start['wall_s']:.1f} s, {start['processor_s']:.1f} s of processor time "
            f"({name} cache, load {start['load_average']:.1f})"
        )
    machine = result["limits"]
    console.print(
        f"one core copies {machine['copy_gb_per_s']:.1f} GB/s, multiplies and adds "
        f"{machine['float32_gflop_per_s']:.0f} Gflop/s (float32)"
    )


def record(result: dict[str, Any], note: str) -> None:
    """Append the main figures to the history."""
    history = json.loads(HISTORY.read_text()) if HISTORY.exists() else []
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=HISTORY.parent
    )
    figures = ("camera_ms", "radar_ms", "own_ms", "whole_step_ms", "resident_mb")
    history.append(
        {
            "date": result["date"],
            "commit": commit.stdout.strip(),
            "note": note,
            "machine": result["machine"],
            "load_average": round(result["load_average"], 1),
            "fleets": {
                f"{stage['fleet']:.0f}": {name: round(stage[name], 3) for name in figures}
                | {
                    name: round(stage["stages_ms"][name], 4)
                    for name in ("render", "detect", "track", "tables")
                }
                for stage in result["stages"]
            },
            "published_search_ms": {k: round(v, 3) for k, v in result["published_search_ms"].items()},
            "start_up_s": {name: round(part["wall_s"], 1) for name, part in result["start_up"].items()},
            "limits": {name: round(value, 1) for name, value in result["limits"].items()},
        }
    )
    HISTORY.write_text(json.dumps(history, indent=1) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--fleets", type=int, nargs="+", default=[1, 10, 100, 500, 1000])
    parser.add_argument("--steps", type=int, default=100, help="of each fleet")
    parser.add_argument("--real-time", type=int, nargs="*", default=[100, 500], help="fleets on two threads")
    parser.add_argument("--cold", action="store_true", help="also start with nothing compiled: a minute")
    parser.add_argument("--out", type=Path, default=Path("out/benchmark.json"))
    parser.add_argument("--record", metavar="NOTE", help="append the main figures to benchmarks/history.json")
    options = parser.parse_args()
    console = Console(highlight=False, width=max(Console().width, WIDTH))
    started = {"warm": start_up(False)}  # compiles the kernels if necessary
    started["warm"] = start_up(False)
    if options.cold:
        started["cold"] = start_up(True)
    result: dict[str, Any] = {
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "load_average": os.getloadavg()[0],
        "limits": limits(),
        "start_up": started,
        "stages": [_in_process(stages_of_fleet, fleet, options.steps) for fleet in options.fleets],
        "published_search_ms": _in_process(search_by_frame),
        "real_time": [_in_process(against_real_time, fleet, 2, 2.0, 3) for fleet in options.real_time],
    }
    print_stages(console, result["stages"])
    print_rest(console, result)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=2) + "\n")
    console.print(f"written: {options.out}", soft_wrap=True)
    if options.record is not None:
        record(result, options.record)


if __name__ == "__main__":
    main()
