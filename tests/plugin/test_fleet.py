"""The fleet in parts: their vehicles, and each vehicle's state."""

from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plugin.fleet import HANDFUL, LEAST_PART, UNEVEN, Fleet
from sumo_net.batch import join, select


class Vehicles(NamedTuple):
    handle: Any
    told: Any  # what each of them was told at its beginning


class State(NamedTuple):
    vehicles: Vehicles


class Telling:
    """A chain that only records new vehicles and copies."""

    def __init__(self) -> None:
        self.begun = 0
        self.copied = 0

    def init(self, handle: Any, names: list[str]) -> State:
        self.begun += len(handle)
        assert names == [f"v{one}" for one in handle]
        return State(Vehicles(handle, self.begun - len(handle) + np.arange(len(handle))))

    def select(self, state: State, rows: Any) -> State:
        self.copied += len(rows)
        return select(state, rows)

    def step(self, state: State, *_: Any) -> tuple[State, None]:
        return state, None

    def join(self, *states: State) -> State:
        self.copied += sum(len(state.vehicles.handle) for state in states)
        return join(*states)


def fleet(threads: int) -> tuple[Fleet, Telling]:
    chain: Any = Telling()
    return Fleet(chain, lambda handle: f"v{handle}", threads), chain


def step(one: Fleet) -> None:
    truth: Any = Vehicles(one.handle, one.handle)
    one.step(truth, one.handle, cast(Any, None), lambda *_: None)()


@given(st.integers(1, 3), st.lists(st.sets(st.integers(0, 90), max_size=80), max_size=8))
def test_every_vehicle_keeps_what_it_has_in_even_parts_in_order(threads: int, drives: list[set[int]]) -> None:
    one, chain = fleet(threads)
    told: dict[int, int] = {}
    for driving in drives:
        handle = np.array(sorted(driving), np.int64)
        begun = chain.begun
        one.follow(handle)
        if len(told) % 2:  # one step, or none, before the next ones come and go
            step(one)
        new = [each for each in handle.tolist() if each not in told]
        told = {each: told[each] for each in handle.tolist() if each in told}
        told |= {each: begun + row for row, each in enumerate(new)}
        np.testing.assert_array_equal(one.handle, handle)
        states: list[Any] = [one.state(part) for part in one._parts]
        have = np.concatenate([state.vehicles.told for state in states])
        assert have.tolist() == [told[each] for each in handle.tolist()]
        sizes = [len(state.vehicles.handle) for state in states]
        assert len(sizes) == max(1, min(threads, len(handle) // LEAST_PART))
        assert max(sizes) - min(sizes) <= max(HANDFUL, len(handle) * UNEVEN)


@pytest.mark.parametrize("leaves", [2, 150])
def test_who_leaves_and_who_comes_move_nobody_of_the_other_part(leaves: int) -> None:
    one, chain = fleet(2)
    one.follow(np.arange(200))
    step(one)
    before = [one.state(part) for part in one._parts]
    chain.copied = 0
    one.follow(np.setdiff1d(np.arange(201), [leaves]))
    step(one)
    same = [one.state(part) is state for part, state in zip(one._parts, before, strict=True)]
    assert same == [leaves > 101, False]
    assert chain.copied < 4 * 100


@pytest.mark.parametrize("threads", [0, -1])
def test_a_fleet_needs_a_thread(threads: int) -> None:
    with pytest.raises(ValueError, match=f"threads = {threads}: must be at least 1"):
        fleet(threads)
