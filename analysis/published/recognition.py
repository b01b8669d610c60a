"""Recognition rates in good and in complex conditions (Zhang et al. 2011, conclusion 1): 100 % and over 90 %.

The published search and the refined chain process the same frames of the same drives, in traffic, on the
straight and on the curved built-in highway. *Recognised*: both borders of the ego lane within 5 px / cos θ on
at least 85 % of the rows where the marking is visible. The source defines neither its criterion nor its
complex conditions; ours are the presets `clear` and `complex`.
"""

import concurrent.futures
import tempfile
from pathlib import Path

import pandas as pd
from pydantic import Field

from analysis.fork_server import ForkServer
from analysis.metrics import distance_km, lane_accuracy
from analysis.published import comparison
from analysis.simulate import simulate
from plugin.record import read_table
from sumo_net.settings import settings

CONDITIONS = {"clear": ("good", 100.0), "complex": ("complex", 90.0)}
CHAINS = {"paper": "paper_recognition_rate", "refined": "recognition_rate"}


@settings
class Recognition:
    """The drives. The seeds are not those used for tuning (below 100)."""

    scenarios: tuple[str, ...] = Field(("straight", "highway"), min_length=1)
    first_seed: int = Field(400, ge=0)
    seeds: int = Field(2, ge=1, le=100)
    duration_s: float = Field(20.0, gt=0, le=3600)
    fraction: float = Field(0.1, gt=0, le=1, description="equipped share")
    workers: int = Field(2, ge=1, le=64)


def rates(experiment: Recognition, out: Path | None = None) -> pd.DataFrame:
    """One row per scenario, condition and chain: share of frames recognised, frames scored, km driven.

    Tables of the runs are kept in `out` if given.
    """
    with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
        keep = Path(work) if out is None else out
        jobs = [
            (scenario, condition, seed, keep / scenario / condition / str(seed), experiment)
            for scenario in experiment.scenarios
            for condition in CONDITIONS
            for seed in range(experiment.first_seed, experiment.first_seed + experiment.seeds)
        ]
        with ForkServer() as server, concurrent.futures.ThreadPoolExecutor(experiment.workers) as pool:
            list(pool.map(lambda job: server.result(_drive, job), jobs))
        steps: dict[tuple[str, str], list[pd.DataFrame]] = {}
        for scenario, condition, _, folder, _ in jobs:
            steps.setdefault((scenario, condition), []).append(read_table(folder, "steps"))
    rows = []
    for (scenario, condition), tables in steps.items():
        whole = pd.concat(tables, ignore_index=True)
        marked = whole[whole["on_marked_road"].fillna(False)]
        accuracy = lane_accuracy(whole)
        for chain, figure in CHAINS.items():
            verdicts = marked["paper_recognised" if chain == "paper" else "recognised"].notna()
            rows.append(
                {
                    "scenario": scenario,
                    "condition": condition,
                    "chain": chain,
                    "recognised_percent": 100.0 * accuracy[figure],
                    "published_percent": CONDITIONS[condition][1],
                    "frames": int(verdicts.sum()),
                    "distance_km": distance_km(whole),
                }
            )
    return pd.DataFrame(rows)


def compare(rate: pd.DataFrame) -> pd.DataFrame:
    """The rates and the source's: 100 % as printed, over 90 % as a bound."""
    rows = []
    for one in rate.to_dict("records"):
        condition, published = CONDITIONS[one["condition"]]
        run = f"{one['scenario']}, {condition} conditions"
        figure = f"recognised, {one['chain']}"
        if condition == "complex":
            rows.append(
                comparison.claim(run, figure, "%", one["recognised_percent"], published, at_most=False)
            )
        else:
            rows.append(comparison.row(run, figure, "%", one["recognised_percent"], published, "printed"))
    return comparison.table(rows)


def reproduce(out: Path, experiment: Recognition | None = None) -> pd.DataFrame:
    """Write recognition.csv, recognition.png and the comparison into `out`; return the comparison."""
    rate = rates(experiment or Recognition())
    return comparison.write(out, "recognition", {"recognition.csv": rate}, compare(rate))


def _drive(job: tuple[str, str, int, Path, Recognition]) -> None:
    scenario, condition, seed, folder, experiment = job
    simulate(
        scenario,
        folder,
        seed=seed,
        duration_s=experiment.duration_s,
        fraction=experiment.fraction,
        condition=condition,
        formats=("parquet",),
        compare_paper=True,
        threads=1,
        quiet=True,
    )
