"""Drives a protocol's trials in SUMO, several runs at a time, and repeats invalid ones."""

import contextlib
import dataclasses
import multiprocessing
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from analysis.protocol.definition import DepartureTest, Protocol
from analysis.protocol.judging import Verdict, judge
from analysis.protocol.planning import Batch, batches, trials_of
from sumo_net.scenario import laid_over

_BASE = "straight"


@dataclass(frozen=True, slots=True)
class Cell:
    """Result of a cell's trials."""

    name: str
    valid: int
    passed: int
    needed: int
    trials: int
    worst_margin: float
    margin_unit: str
    spread_m: float  # of the alerts; NaN if the test does not bound it
    spread_most_m: float
    ok: bool
    why: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a protocol: every attempt, the cells, and whether all passed."""

    protocol: Protocol
    verdicts: tuple[Verdict, ...]
    cells: tuple[Cell, ...]
    share: float
    passed: bool


@contextlib.contextmanager
def worker_pool(workers: int) -> Iterator[Executor]:
    """Processes that each drive one run at a time, and keep compiled kernels for the next."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, context) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def drive(
    protocol: Protocol,
    pool: Executor,
    *,
    mode: str = "refined",
    changes: dict[str, Any] | None = None,
    seed: int = 1,
    told: Callable[[int, int], None] = lambda done, all_: None,
) -> Outcome:
    """Drive all trials; `changes` override the protocol's settings, `told` gets the runs done and all runs.

    Raises SettingsError or TrafficError.
    """
    protocol = dataclasses.replace(protocol, settings=laid_over(protocol.settings, changes or {}))
    todo, verdicts = trials_of(protocol), []
    with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
        for attempt in range(1, protocol.attempts + 1):
            made = batches(protocol, [dataclasses.replace(trial, attempt=attempt) for trial in todo])
            jobs = {
                pool.submit(_run, batch, Path(work) / f"{attempt}_{k}", mode, seed): k
                for k, batch in enumerate(made)
            }
            found: dict[int, list[Verdict]] = {}
            for done, job in enumerate(as_completed(jobs)):
                found[jobs[job]] = job.result()
                told(done + 1, len(made))
            verdicts += [verdict for k in range(len(made)) for verdict in found[k]]
            bad = {(v.cell, v.trial) for k in found for v in found[k] if not v.valid}
            todo = [trial for trial in todo if (trial.cell, trial.number) in bad]
            if not todo:
                break
    order = {trial.cell: k for k, trial in enumerate(trials_of(protocol))}
    verdicts.sort(key=lambda v: (order[v.cell], v.trial, v.attempt))
    return outcome(protocol, verdicts)


def outcome(protocol: Protocol, verdicts: Iterable[Verdict]) -> Outcome:
    """Cells and total of the verdicts."""
    rows = tuple(verdicts)
    cells = []
    for name, test in {trial.cell: trial.test for trial in trials_of(protocol)}.items():
        mine = [v for v in rows if v.cell == name]
        spread_most = test.spread_most_m if isinstance(test, DepartureTest) else None
        cells.append(_cell(name, mine, test.trials, test.least_passed, spread_most))
    valid = [v for v in rows if v.valid]
    share = sum(v.passed for v in valid) / max(sum(cell.trials for cell in cells), 1)
    passed = all(cell.ok for cell in cells) and share >= protocol.overall_share - 1e-3
    return Outcome(protocol, rows, tuple(cells), share, passed)


def _cell(name: str, rows: list[Verdict], trials: int, needed: int, spread_most: float | None) -> Cell:
    valid = [v for v in rows if v.valid]
    passed = sum(v.passed for v in valid)
    margins = [v.margin for v in valid if v.margin == v.margin]
    nan = float("nan")
    spread, why = nan, ""
    if spread_most is not None:
        places = [v.distance_to_line_m for v in valid if v.alert_kind]
        spread = max(places) - min(places) if places else nan
        if not spread <= spread_most:
            why = f"alerts {spread:.2f} m apart"
    if passed < needed:
        said = sorted({v.why for v in valid if not v.passed} or {v.why for v in rows})
        why = "; ".join(said)
    unit = next((v.margin_unit for v in valid if v.margin_unit), "")
    worst = min(margins) if margins else nan
    most = nan if spread_most is None else spread_most
    return Cell(name, len(valid), passed, needed, trials, worst, unit, spread, most, not why, why)


def _run(batch: Batch, out: Path, mode: str, seed: int) -> list[Verdict]:
    """One run of SUMO and the verdicts on its trials, in a separate process."""
    from analysis.simulate import settings_of, simulate
    from plugin.record import read_table

    options: dict[str, Any] = {"seed": seed, "mode": mode, "changes": batch.changes}
    front = settings_of(_BASE, **options).vehicle.front_axle_m
    simulate(_BASE, out, formats=("parquet",), threads=1, quiet=True, **options)
    steps, tracks = (_by_vehicle(read_table(out, name)) for name in ("steps", "tracks"))
    return [
        judge(trial, steps(trial.vehicle_id), tracks(trial.vehicle_id), batch.half_span_m, front)
        for trial in batch.trials
    ]


def _by_vehicle(table: pd.DataFrame) -> Callable[[str], pd.DataFrame]:
    parts = dict(list(table.groupby("vehicle_id", observed=True)))
    return lambda name: parts.get(name, table.iloc[:0])
