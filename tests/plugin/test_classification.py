"""The motion classes: published transitions, thresholds and cycles, and no others."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plugin.tracking import classification as c
from plugin.tracking.classification import ClassSettings
from plugin.tracking.classification_kernels import (
    ONCOMING,
    SAME_DIRECTION,
    STATIONARY,
    STOPPED_ONCOMING,
    STOPPED_SAME,
    UNCLASSIFIED,
    advance,
)

PLAIN = ClassSettings(minimum_speed_mps=1.5, k1=0.0, k2_s=0.0)
TRANSITIONS = {  # as published
    (UNCLASSIFIED, STATIONARY),
    (UNCLASSIFIED, SAME_DIRECTION),
    (UNCLASSIFIED, ONCOMING),
    (SAME_DIRECTION, STOPPED_SAME),
    (ONCOMING, STOPPED_ONCOMING),
    (STATIONARY, SAME_DIRECTION),
    (STATIONARY, ONCOMING),
    (STOPPED_SAME, SAME_DIRECTION),
    (STOPPED_SAME, ONCOMING),
    (STOPPED_ONCOMING, SAME_DIRECTION),
    (STOPPED_ONCOMING, ONCOMING),
}


def run(speeds: list[float], measured: list[bool] | None = None, options: ClassSettings = PLAIN) -> list[int]:
    """The class after each cycle of one track, V_t = V_min."""
    state, seen = c.init(1), measured or [True] * len(speeds)
    states = []
    for v, m in zip(speeds, seen, strict=True):
        threshold = c.moving_threshold(options, np.zeros(1), np.zeros(1))
        advance(*state, np.array([v]), np.array([m]), threshold, c.rules(options))
        states.append(int(state.state[0]))
    return states


def test_threshold_is_equation_16() -> None:
    options = ClassSettings(minimum_speed_mps=1.0, k1=0.05, k2_s=0.2)
    threshold = c.moving_threshold(options, np.array([0.0, 20.0]), np.array([0.0, -2.0]))
    np.testing.assert_allclose(threshold, [1.0, 1.0 + 1.0 - 0.4])


@pytest.mark.parametrize(
    ("speed", "settled"),
    [
        (0.0, STATIONARY),
        (1.49, STATIONARY),
        (1.5, SAME_DIRECTION),
        (-2.99, STATIONARY),
        (-3.0, ONCOMING),
    ],
)
def test_a_class_is_given_in_the_third_cycle(speed: float, settled: int) -> None:
    assert run([speed] * 3) == [UNCLASSIFIED, UNCLASSIFIED, settled]


def test_unstable_speed_or_missing_measurements_delay_the_class() -> None:
    assert run([20, 20, 0, 20, 20, 20])[-2:] == [UNCLASSIFIED, SAME_DIRECTION]
    assert run([20] * 4, [True, True, False, True])[-2:] == [UNCLASSIFIED, SAME_DIRECTION]


@pytest.mark.parametrize(
    ("speed", "moving", "stopped"),
    [(20.0, SAME_DIRECTION, STOPPED_SAME), (-20.0, ONCOMING, STOPPED_ONCOMING)],
)
def test_moving_stops_in_the_second_cycle_and_goes_in_the_third(
    speed: float, moving: int, stopped: int
) -> None:
    assert run([speed] * 3 + [0.0, speed, 0.0, 0.0])[-4:] == [moving, moving, moving, stopped]
    assert run([speed] * 3 + [0.0] * 2 + [speed] * 3)[-3:] == [stopped, stopped, moving]
    other = ONCOMING if moving == SAME_DIRECTION else SAME_DIRECTION
    assert run([speed] * 3 + [0.0] * 2 + [-speed] * 3)[-1] == other


def test_slower_than_the_thresholds_of_moving_is_a_stop() -> None:
    assert run([20.0] * 3 + [1.49] * 2)[-1] == STOPPED_SAME  # V_t = 1.5
    assert run([20.0] * 3 + [1.5] * 9)[-1] == SAME_DIRECTION
    assert run([-20.0] * 3 + [-2.99] * 2)[-1] == STOPPED_ONCOMING  # V_x = -3
    assert run([-20.0] * 3 + [-3.0] * 9)[-1] == ONCOMING


def test_stationary_goes_only_strictly_beyond_the_thresholds() -> None:
    assert run([0.0] * 3 + [1.5] * 9)[-1] == STATIONARY
    assert run([0.0] * 3 + [1.51] * 3)[-3:] == [STATIONARY, STATIONARY, SAME_DIRECTION]
    assert run([0.0] * 3 + [-3.0] * 9)[-1] == STATIONARY
    assert run([0.0] * 3 + [-3.01] * 3)[-1] == ONCOMING


def test_same_direction_never_turns_oncoming_without_a_stop() -> None:
    assert run([20.0] * 3 + [-20.0] * 9)[-1] == SAME_DIRECTION


def test_near_zero_stops_even_above_a_tiny_threshold() -> None:
    options = ClassSettings(minimum_speed_mps=0.1, k1=0.0, k2_s=0.0, near_zero_mps=0.5)
    assert run([20.0] * 3 + [0.3] * 2, options=options)[-1] == STOPPED_SAME


@given(
    seed=st.integers(0, 2**32 - 1),
    cycles=st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(1, 4)),
    minimum=st.floats(0.05, 5.0),
)
@settings(max_examples=60)
def test_no_illegal_transition_ever(seed: int, cycles: tuple[int, int, int], minimum: float) -> None:
    rng, tracks = np.random.default_rng(seed), 30
    settle, stop, go = cycles
    options = ClassSettings(minimum_speed_mps=minimum, settle_cycles=settle, stop_cycles=stop, go_cycles=go)
    state, since = c.init(tracks), np.zeros(tracks, np.int64)
    speed = np.zeros(tracks)
    for _ in range(60):
        jump = rng.random(tracks) < 0.3
        speed = np.where(jump, rng.choice([-20, -3.0, -1, 0, 0.4, 1.5, 3, 20, np.nan, np.inf], tracks), speed)
        threshold = c.moving_threshold(options, rng.uniform(0, 40, tracks), rng.uniform(-9, 3, tracks))
        before = state.state.copy()
        advance(*state, speed, rng.random(tracks) < 0.8, threshold, c.rules(options))
        since += 1
        for t in np.flatnonzero(before != state.state):
            change = (int(before[t]), int(state.state[t]))
            assert change in TRANSITIONS
            needed = {0: settle, 2: stop, 3: stop}.get(change[0], go)
            assert since[t] >= needed
            since[t] = 0
