"""The chains of the whole equipped fleet: vehicles come and go, and threads share the work."""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np

from plugin.chain import Chain, ChainState, Outcome
from sumo_net.batch import select
from sumo_net.ego import EgoTruth
from sumo_net.snapshot import Snapshot

Array = np.ndarray[Any, Any]
J = TypeVar("J")

UNEVEN = 1 / 32  # of the fleet; parts that differ by more are made anew, which copies all that is known
LEAST_PART = 16  # vehicles in the hands of a thread: what its calls cost is spread over them


class Fleet:
    """The equipped vehicles, in the order of their handles, in as many parts as threads are worth having."""

    def __init__(self, chain: Chain, name: Callable[[int], str], threads: int | None = None) -> None:
        """`name`: id of a vehicle by handle. `threads`: default one for each processor."""
        self._chain, self._name = chain, name
        self._threads = threads or os.cpu_count() or 1
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        self._parts = [chain.init(np.zeros(0, np.int64), [])]

    @property
    def handle(self) -> Array:
        """(n,) of the vehicles in it."""
        return np.concatenate([part.vehicles.handle for part in self._parts])

    def follow(self, handle: Array) -> None:
        """From now on it consists of these vehicles, (n,) ascending."""
        have = self.handle
        if np.array_equal(have, handle):
            return
        new = handle[~np.isin(handle, have, assume_unique=True)]
        fresh = self._chain.init(new, [self._name(one) for one in new.tolist()])
        parts = self._parts
        cuts = np.searchsorted(handle, [part.vehicles.handle[0] for part in parts[1:]])
        count = max(1, min(self._threads, len(handle) // LEAST_PART))
        sizes = np.diff(cuts, prepend=0, append=len(handle))
        if len(parts) != count or sizes.max() - sizes.min() > len(handle) * UNEVEN:
            parts = [self._chain.join(*parts, fresh)] * count
            cuts = np.array([len(handle) * part // count for part in range(1, count)], np.int64)
        elif len(new):
            arrived = np.split(np.arange(len(new)), np.searchsorted(np.searchsorted(handle, new), cuts))
            parts = [
                self._chain.join(part, self._chain.select(fresh, rows)) if len(rows) else part
                for part, rows in zip(parts, arrived, strict=True)
            ]
        self._parts = [self._of(part, some) for part, some in zip(parts, np.split(handle, cuts), strict=True)]

    def _of(self, part: ChainState, handle: Array) -> ChainState:
        """The vehicles `handle`, ascending, of a part that has them; the part itself where these are all."""
        have = part.vehicles.handle
        if np.array_equal(have, handle):
            return part
        order = np.argsort(have)
        return self._chain.select(part, order[np.searchsorted(have[order], handle)])

    def step(
        self,
        truth: EgoTruth,
        half_span_m: Array,
        snapshot: Snapshot,
        judge: Callable[[slice, Outcome], J],
    ) -> list[tuple[Outcome, J]]:
        """One step of its n > 0 vehicles: what came of it, part by part.

        `judge` is given the vehicles of a part and what came of it, by the thread that has worked on it.
        """

        def work(state: ChainState, part: slice) -> tuple[ChainState, Outcome, J]:
            after, outcome = self._chain.step(state, select(truth, part), half_span_m[part], snapshot)
            return after, outcome, judge(part, outcome)

        ends = np.cumsum([len(state.vehicles.handle) for state in self._parts]).tolist()
        slices = [slice(begin, end) for begin, end in itertools.pairwise([0, *ends])]
        run = self._pool.map if self._pool is not None and len(slices) > 1 else map
        done = list(run(work, self._parts, slices))
        self._parts = [after for after, _, _ in done]
        return [(outcome, judged) for _, outcome, judged in done]

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
