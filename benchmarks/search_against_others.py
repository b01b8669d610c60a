"""The published genetic search compared with scipy's differential evolution and PyGAD on one objective.

    python benchmarks/search_against_others.py [--frames 4] [--seeds 2] [--out out/bench/search.json]

One problem is one border of one rendered frame, searched in the first frame's region. All three use the same
block maps and the same compiled objective; the others call it for a population of 50 at once, their fastest
way. Measured is the processor time until 60, 75 and 90 % of the best known value are reached (from a long run
of differential evolution beforehand); a run that ends before is restarted with other draws, and its time
counts. The published coding has steps of 0.8e-4, 0.008 and 1 px, so that the best value on its grid is below
the continuous one. Packages: `pip install -e '.[bench]'`.
"""

import argparse
import contextlib
import logging
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pygad
from scipy.optimize import differential_evolution
from side_by_side import cpu_seconds, report

from analysis.published.search_times import SearchTimes, frames_at
from plugin.lane.genetic import GeneticSearch, search_numbers
from plugin.lane.genetic_kernels import evolve
from plugin.lane.objective import objective
from plugin.lane.objective_kernels import (
    BLOCKS,
    FIRST_COLUMN,
    LAST_COLUMN,
    block_map,
    mean_value,
    road_grey,
    slope_class,
)
from sumo_net.compile import kernel
from sumo_net.randomness import stream_key

NUMBERS = search_numbers(GeneticSearch())
TARGETS = (0.6, 0.75, 0.9)
POPULATION, GENERATIONS, BUDGET_S = 50, 180, 2.0
_NONE = np.empty(0)


class Problem(NamedTuple):
    """One border of one frame."""

    frame: np.ndarray
    side: int
    maps: np.ndarray
    roads: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def sign(self) -> float:
        """+1 left, -1 right."""
        return 1.0 if self.side == 0 else -1.0


class Over(Exception):  # noqa: N818 - ends a race, not an error
    """Raised inside an optimiser when all targets are reached or the budget is spent."""


@kernel
def values_of(maps, roads, sign, candidates, blocks, minimum_blocks, out):  # type: ignore[no-untyped-def]
    """out[i] = F of candidates (m, 3): what `evolve` computes for an individual."""
    for i in range(candidates.shape[0]):
        row = slope_class(sign * candidates[i, 1])
        out[i] = mean_value(
            maps[row],
            candidates[i, 0],
            candidates[i, 1],
            candidates[i, 2],
            roads[row],
            blocks,
            minimum_blocks,
        )


def problems(count: int) -> list[Problem]:
    """Both borders of `count` frames, half clear, half complex."""
    made = []
    for condition in ("clear", "complex"):
        n = (count + 1) // 2
        keys = np.array([stream_key(9, f"car {i}", "camera") for i in range(n)], np.uint64)
        for frame in frames_at(SearchTimes(vehicles=n, condition=condition), keys, 0):
            grey = road_grey(frame, *NUMBERS.region)
            for side in range(2):
                maps = np.zeros((3, BLOCKS, 320), np.int32)
                everywhere = np.full(BLOCKS, FIRST_COLUMN), np.full(BLOCKS, LAST_COLUMN)
                for row in range(3):
                    block_map(frame, NUMBERS.stencils[side, row], BLOCKS, *everywhere, maps[row])
                first = NUMBERS.first[side]
                low, high = (np.ascontiguousarray(first[:, k]) for k in range(2))
                made.append(Problem(frame, side, maps, NUMBERS.alpha * grey, low, high))
    return made


def value(problem: Problem, candidates: np.ndarray) -> np.ndarray:
    """F of candidates (m, 3)."""
    out = np.empty(len(candidates))
    rows = np.ascontiguousarray(candidates, np.float64)
    values_of(problem.maps, problem.roads, problem.sign, rows, NUMBERS.blocks, NUMBERS.minimum_blocks, out)
    return out


def best_known(problem: Problem) -> float:
    """Best value of a long differential evolution with a large population."""
    found = differential_evolution(
        lambda x: -value(problem, x.T),
        list(zip(problem.low, problem.high, strict=True)),
        popsize=100,
        maxiter=300,
        tol=1e-8,
        seed=0,
        vectorized=True,
        updating="deferred",
        polish=False,
    )
    return float(-found.fun)


class Race:
    """Processor time from the start until each of TARGETS was first reached, and the border there."""

    def __init__(self, problem: Problem, best: float) -> None:
        self.problem, self.targets = problem, [share * best for share in TARGETS]
        self.seconds = [np.inf] * len(TARGETS)
        self.borders = [np.full(3, np.nan)] * len(TARGETS)
        self._begin = time.process_time()

    def note(self, best: float, border: np.ndarray, at: float | None = None) -> None:
        """Record a value found now or `at` seconds after the start. Raises Over when the race is finished."""
        now = time.process_time() - self._begin if at is None else at
        for k, target in enumerate(self.targets):
            if best >= target and not np.isfinite(self.seconds[k]):
                self.seconds[k], self.borders[k] = now, border.copy()
        if np.isfinite(self.seconds[-1]) or now > BUDGET_S:
            raise Over

    def fitness(self, candidates: np.ndarray) -> np.ndarray:
        """F of candidates (m, 3), recorded."""
        values = value(self.problem, candidates)
        best = int(values.argmax())
        self.note(float(values[best]), candidates[best])
        return values


def ours(race: Race, seed: int) -> None:
    """The published search, restarted until the budget is spent."""
    p, best = race.problem, np.empty(3)
    widths, key = NUMBERS.bits[p.side, 0], stream_key(seed, "search", "bench")

    def run(generations: int, restart: int, history: np.ndarray) -> float:
        counter = np.uint64(restart << 32)
        where = p.low, p.high, widths, generations, key, counter, NUMBERS, best, history
        return float(evolve(p.maps, p.roads, p.sign, *where))

    before, history = 0.0, np.empty(GENERATIONS + 1)
    for restart in range(1_000_000):
        whole, _ = cpu_seconds(lambda r=restart: run(GENERATIONS, r, history))
        for target, known in zip(race.targets, race.seconds, strict=True):
            there = np.flatnonzero(history >= target)
            if len(there) and not np.isfinite(known):
                # the same draws again, up to the generation that reached it
                part, reached = cpu_seconds(lambda r=restart, g=int(there[0]): run(g, r, _NONE), 3)
                race.note(reached, best, before + part)
        before += whole
        race.note(-np.inf, best, before)


def scipys(race: Race, seed: int) -> None:
    """scipy's differential evolution, restarted when it has converged."""
    bounds = list(zip(race.problem.low, race.problem.high, strict=True))
    for restart in range(1_000_000):
        differential_evolution(
            lambda x: -race.fitness(np.ascontiguousarray(x.T)),
            bounds,
            popsize=-(-POPULATION // 3),
            maxiter=GENERATIONS,
            seed=1000 * seed + restart,
            vectorized=True,
            updating="deferred",
            polish=False,
        )


def pygads(race: Race, seed: int) -> None:
    """PyGAD with the published population, generations and rates."""

    def fitness(_: Any, solutions: np.ndarray, __: Any) -> list[float]:
        return list(race.fitness(np.atleast_2d(np.asarray(solutions, float))))

    space = [
        {"low": low, "high": high} for low, high in zip(race.problem.low, race.problem.high, strict=True)
    ]
    logger = logging.getLogger("pygad-bench")
    logger.addHandler(logging.NullHandler())  # PyGAD logs the exception that ends it
    logger.propagate = False
    for restart in range(1_000_000):
        pygad.GA(
            num_generations=GENERATIONS,
            sol_per_pop=POPULATION,
            num_parents_mating=POPULATION // 2,
            num_genes=3,
            gene_space=space,
            fitness_func=fitness,
            fitness_batch_size=POPULATION,
            parent_selection_type="rws",
            keep_elitism=1,
            crossover_probability=0.45,
            mutation_num_genes=1,
            random_seed=1000 * seed + restart,
            suppress_warnings=True,
            logger=logger,
        ).run()


METHODS = {"this project": ours, "scipy differential evolution": scipys, "PyGAD": pygads}


def race(name: str, problem: Problem, best: float, seed: int) -> list[float]:
    """Seconds until each of TARGETS; the public objective must confirm the value."""
    one = Race(problem, best)
    with contextlib.suppress(Over):
        METHODS[name](one, seed)
    for border, target in zip(one.borders, one.targets, strict=True):
        if np.isfinite(border[0]):
            other = np.zeros((1, 3))
            pair = (border[None], other) if problem.side == 0 else (other, border[None])
            checked = objective(problem.frame[None], *pair)[0, problem.side]
            assert checked >= target - 1e-9, (name, checked, target)
    return one.seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--frames", type=int, default=4)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("out/bench/search.json"))
    options = parser.parse_args()
    made = problems(options.frames)
    best = [best_known(problem) for problem in made]
    seconds: dict[str, list[list[float]]] = {}
    for name in METHODS:
        race(name, made[0], best[0], 99)  # compiles, imports
        seconds[name] = [
            race(name, problem, known, seed)
            for problem, known in zip(made, best, strict=True)
            for seed in range(options.seeds)
        ]
    rows = []
    for k, share in enumerate(TARGETS):
        base = np.median([row[k] for row in seconds["this project"]])
        for name in METHODS:
            spent = np.array([row[k] for row in seconds[name]])
            rows.append(
                {
                    "value reached": f"{share:.0%} of the best known",
                    "search": name,
                    "ms, median": 1e3 * float(np.median(spent)),
                    "ms, worst": 1e3 * float(spent.max()),
                    "reached, %": 100.0 * float(np.mean(np.isfinite(spent))),
                    "times ours": float(np.median(spent) / base),
                }
            )
    note = (
        f"{len(made)} borders x {options.seeds} seeds, at most {BUDGET_S:g} s of processor time each "
        "(inf: not reached); every border reached was checked by plugin.lane.objective.objective"
    )
    report("Search of one border, first frame's region", rows, options.out, ("scipy", "pygad"), note)


if __name__ == "__main__":
    main()
