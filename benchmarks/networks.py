"""Runs on networks of many shapes: does one fail, is an unknown value reported as known?

    python benchmarks/networks.py [--duration 30] [--networks grid tracks] [--configuration mine.sumocfg]

One row per network: equipped vehicles (20 % of the cars, and every bus, lorry, motorcycle, bicycle and tram);
how often moving ones saw the lane with and without markings beside them; how often its borders were right or
wrong where a marking was visible in the image; warnings without markings; the largest distance of a vehicle
from its lane. Exit status 1 if a run failed or a rule of `faults` was violated.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

ALWAYS = (
    "time_s",
    "speed_mps",
    "true_x_m",
    "true_y_m",
    "true_lateral_offset_m",
    "true_lane_width_m",
    "true_heading_error_rad",
    "true_lateral_speed_mps",
    "true_yaw_rate_rps",
    "lane_score",
)
SEEN = ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "lane_width_m")


def faults(steps: pd.DataFrame) -> list[str]:
    """Violations in a table of steps of the rules on known and unknown values."""
    found = []
    for name in ALWAYS:
        if steps[name].isna().any():
            found.append(f"{name} is empty in {int(steps[name].isna().sum())} rows")
    numbers = steps.select_dtypes("number")
    for name in numbers.columns[np.isinf(numbers).any()]:
        found.append(f"{name} is infinite")
    locked = steps["lane_locked"].astype(bool)
    for name in SEEN:
        differs = int((steps[name].notna() != locked).sum())
        if differs:
            found.append(f"{name} is there without the lane, or the other way round, in {differs} rows")
    for name in ("left_c", "right_c"):  # a border may be outside the image
        ghosts = int((steps[name].notna() & ~locked).sum())
        if ghosts:
            found.append(f"{name} is there without the lane in {ghosts} rows")
    blind = steps["lateral_speed_mps"].isna() & steps["ldw_state"].isin(["ready", "suppressed"])
    if blind.any():
        found.append(f"ready, with no motion known, in {int(blind.sum())} rows")
    unseen = (steps["ldw_state"] == "lane not seen") & steps["tlc_s"].notna()
    if unseen.any():
        found.append(f"lane not seen, and yet a time to its crossing, in {int(unseen.sum())} rows")
    return found


def row(name: str, out: Path, cpu_s: float) -> dict[str, object]:
    """One row of figures from a run's tables."""
    steps = pd.read_csv(out / "steps.csv", low_memory=False)
    moving = steps[steps["speed_mps"] > 3.0]
    marked = moving["on_marked_road"].astype(bool)
    shown = moving[marked & moving["recognised"].notna()]
    right = shown["recognised"].astype(bool)
    return {
        "network": name,
        "vehicles": steps["vehicle_id"].nunique(),
        "rows": len(steps),
        "seen_%": round(100 * moving["lane_locked"][marked].mean(), 1),
        "right_%": round(100 * right.mean(), 1),
        "wrong_%": round(100 * (shown["lane_locked"] & ~right).mean(), 1),
        "seen_unmarked_%": round(100 * moving["lane_locked"][~marked].mean(), 1),
        "unmarked_%": round(100 * (~marked).mean(), 1),
        "warned_unmarked": int((moving["ldw_active"][~marked]).sum()),
        "over_2m_off_%": round(100 * (steps["true_lateral_offset_m"].abs() > 2.0).mean(), 2),
        "most_off_m": round(steps["true_lateral_offset_m"].abs().max(), 1),
        "cpu_s": round(cpu_s, 1),
        "faults": "; ".join(faults(steps)),
    }


def main() -> None:
    """Run, print the table."""
    from analysis.simulate import simulate
    from benchmarks.road_networks import NETWORKS, write_scenario

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--networks", nargs="*", default=list(NETWORKS), choices=list(NETWORKS))
    parser.add_argument("--configuration", type=Path, nargs="*", default=[], help="a .sumocfg beside them")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(prefix="sumo-adas-networks-") as work:
        jobs = [(name, None) for name in given.networks] + [(file.stem, file) for file in given.configuration]
        for name, file in jobs:
            out, began = Path(work) / name / "out", time.process_time()
            try:
                source = file or write_scenario(name, Path(work) / name, given.duration)
                simulate(
                    str(source), out, duration_s=given.duration, fraction=0.2, quiet=True, seed=given.seed
                )
                rows.append(row(name, out, time.process_time() - began))
            except Exception as error:
                rows.append({"network": name, "faults": f"{type(error).__name__}: {error}"})
            print(rows[-1], file=sys.stderr, flush=True)
    print(pd.DataFrame(rows).to_string(index=False))
    raise SystemExit(1 if any(one["faults"] for one in rows) else 0)


if __name__ == "__main__":
    main()
