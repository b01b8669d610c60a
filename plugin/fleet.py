"""The chains of the whole equipped fleet: vehicles come and go, and threads share the work."""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeVar

import numpy as np

from plugin.chain import Chain, ChainState, Outcome
from sumo_net.arrays import Array
from sumo_net.batch import ALL, select
from sumo_net.ego import EgoTruth
from sumo_net.snapshot import Snapshot

J = TypeVar("J")

UNEVEN = 1 / 64  # of the fleet, at least HANDFUL vehicles: if parts differ by more, they are split again
HANDFUL = 4
LEAST_PART = 16  # vehicles per thread, which share the cost of its calls


class Part(NamedTuple):
    """The vehicles of a part of the fleet, and the rows of the states that they come from."""

    handle: Array  # (n,) ascending
    sources: list[tuple[ChainState, Array]]


class Fleet:
    """The equipped vehicles in the order of their handles, in one part for each thread that pays."""

    def __init__(self, chain: Chain, name: Callable[[int], str], threads: int | None = None) -> None:
        """`name`: id of a vehicle by handle. `threads`: at least 1, by default one for each processor."""
        if threads is not None and threads < 1:
            raise ValueError(f"threads = {threads}: must be at least 1")
        self._chain, self._name = chain, name
        self._threads = threads if threads is not None else (os.cpu_count() or 1)
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        self._parts = [_whole(chain.init(np.zeros(0, np.int64), []))]

    @property
    def handle(self) -> Array:
        """(n,) handles of its vehicles."""
        return np.concatenate([part.handle for part in self._parts])

    def follow(self, handle: Array) -> None:
        """Let the fleet consist of the vehicles `handle` (n,), ascending, from now on."""
        have = self.handle
        if np.array_equal(have, handle):
            return
        new = handle[~np.isin(handle, have, assume_unique=True)]
        states = [self.state(part) for part in self._parts]
        states.append(self._chain.init(new, [self._name(one) for one in new.tolist()]))
        cuts = np.searchsorted(handle, [part.handle[0] for part in self._parts[1:]])
        count = max(1, min(self._threads, len(handle) // LEAST_PART))
        sizes = np.diff(cuts, prepend=0, append=len(handle))
        uneven = max(HANDFUL, len(handle) * UNEVEN)
        if len(sizes) != count or sizes.max() - sizes.min() > uneven:
            # new vehicles join the last part, so it begins smaller
            share = (len(handle) + uneven / 2.0) / count
            cuts = np.array([int(share * part) for part in range(1, count)], np.int64)
        self._parts = [_taken(some, states) for some in np.split(handle, cuts)]

    def state(self, part: Part) -> ChainState:
        """State of the vehicles of a part, in the order of their handles."""
        taken = [
            state if len(rows) == len(state.vehicles.handle) else self._chain.select(state, rows)
            for state, rows in part.sources
        ]
        state = self._chain.join(*taken) if len(taken) > 1 else taken[0]
        if (state.vehicles.handle == part.handle).all():
            return state
        return self._chain.select(state, np.argsort(state.vehicles.handle))

    def step(
        self,
        truth: EgoTruth,
        half_span_m: Array,
        snapshot: Snapshot,
        judge: Callable[[slice, Outcome], J],
    ) -> Callable[[], list[tuple[Outcome, J]]]:
        """Begin a step of the n > 0 vehicles; the function returned waits for the results, part by part.

        `judge` is called with the rows of a part and its outcome, in the thread that has processed it.
        """

        def work(part: Part, rows: slice) -> tuple[ChainState, Outcome, J]:
            state = self.state(part)
            after, outcome = self._chain.step(state, select(truth, rows), half_span_m[rows], snapshot)
            return after, outcome, judge(rows, outcome)

        ends = np.cumsum([len(part.handle) for part in self._parts]).tolist()
        slices = [slice(*cut) for cut in itertools.pairwise([0, *ends])] if len(ends) > 1 else [ALL]
        run = self._pool.map if self._pool is not None and len(slices) > 1 else map
        begun = run(work, self._parts, slices)

        def finish() -> list[tuple[Outcome, J]]:
            done = list(begun)
            self._parts = [_whole(after) for after, _, _ in done]
            return [(outcome, judged) for _, outcome, judged in done]

        return finish

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def _whole(state: ChainState) -> Part:
    return Part(state.vehicles.handle, [(state, np.arange(len(state.vehicles.handle)))])


def _taken(handle: Array, states: list[ChainState]) -> Part:
    """A part of the vehicles `handle`, found in `states`."""
    sources = [
        (state, np.flatnonzero(np.isin(state.vehicles.handle, handle, assume_unique=True)))
        for state in states
    ]
    return Part(handle, [one for one in sources if len(one[1])] or sources[:1])
