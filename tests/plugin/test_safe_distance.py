"""The published distances by hand, and properties that hold for all parameters."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from plugin.warning.safe_distance import (
    MODELS,
    SURFACES,
    SafeDistance,
    numbers,
    safe_distances,
    time_to_collision,
)

speeds = st.floats(3.0, 45.0)
brakes = st.floats(-9.0, 0.0)


def distances(model: str, v: float, v_l: float, a: float = 0.0, a_l: float = 0.0, **more: object) -> tuple:
    return safe_distances(v, a, v_l, a_l, numbers(SafeDistance(model=model, **more)))


def test_published_formulas_by_hand() -> None:
    mazda = 0.5 * (900 / 6 - 400 / 8) + 30 * 0.1 + 10 * 0.6 + 5
    assert distances("mazda", 30.0, 20.0) == pytest.approx((mazda + 5.0, mazda))
    assert distances("honda", 30.0, 20.0) == pytest.approx(
        (2.2 * 10 + 6.2, 10 * 1.5 + 0.5 * 1.5 * 7.8 - 0.5 * 7.8 * 0.25)
    )
    stops = 1.5 * 15 - 0.5 * 7.8 * 1.0 - 25 / (2 * 7.8)  # 5 m/s are gone within 1.5 s
    assert distances("honda", 15.0, 5.0) == pytest.approx((2.2 * 10 + 6.2, stops))
    assert distances("berkeley", 30.0, 20.0) == pytest.approx((500 / 12 + 30 * 1.2 + 5, 10 * 1.2 + 3 * 1.44))


def test_camp_by_hand() -> None:
    g = 9.80665
    standing = (0.165 + 0.00889 * 20) * g  # the leader stands: full speed is to be braked away
    assert distances("camp", 20.0, 0.0)[1] == pytest.approx(20 * 0.9 + 400 / (2 * standing) + 1.0)
    slower = (0.165 - 0.080 + 0.00889 * 10) * g
    assert distances("camp", 30.0, 20.0)[0] == pytest.approx(10 * 1.9 + 100 / (2 * slower) + 1.0)
    # A leader that brakes by 3 m/s² from the same 30 m/s: 2.7 m/s slower after 0.9 s, and stops first.
    a_l, c = -3.0, 2.7
    need = (0.165 - 0.685 * a_l / g - 0.080 + 0.00889 * c) * g
    assert c / (need + a_l) > 27.3 / 3.0
    onset = 30.0**2 / (2 * need) - 27.3**2 / 6.0
    assert distances("camp", 30.0, 30.0, a_l=a_l)[1] == pytest.approx(0.5 * 3 * 0.81 + onset + 1.0)


def follow(gap: float, v: float, a: float, v_l: float, a_l: float, dt: float = 1e-3) -> float:
    """The same drive in small steps."""
    for k in range(int(30 / dt)):
        if gap <= 0:
            return k * dt
        way = max(v * dt + 0.5 * a * dt * dt, 0.0)
        way_l = max(v_l * dt + 0.5 * a_l * dt * dt, 0.0)
        gap, v, v_l = gap - way + way_l, max(v + a * dt, 0.0), max(v_l + a_l * dt, 0.0)
    return math.inf


@given(st.floats(1.0, 80.0), speeds, st.floats(-6.0, 2.0), st.floats(0.0, 40.0), st.floats(-9.0, 2.0))
@settings(max_examples=60)
def test_time_to_collision_is_that_of_the_drive_in_small_steps(
    gap: float, v: float, a: float, v_l: float, a_l: float
) -> None:
    t, stepped = time_to_collision(gap, v, a, v_l, a_l), follow(gap, v, a, v_l, a_l)
    if math.isinf(stepped):
        # A hit by a hair may be missed in steps.
        assert t > 25.0 or math.isinf(time_to_collision(gap * 1.01 + 0.05, v, a, v_l, a_l))
    elif math.isinf(t):
        assert math.isfinite(time_to_collision(gap * 0.99 - 0.05, v, a, v_l, a_l))
    else:
        assert t == pytest.approx(stepped, abs=0.02) or math.isinf(
            time_to_collision(gap + 0.1, v, a, v_l, a_l)
        )


def test_time_to_collision_at_constant_speeds() -> None:
    assert time_to_collision(30.0, 25.0, 0.0, 15.0, 0.0) == pytest.approx(3.0)
    assert time_to_collision(30.0, 15.0, 0.0, 25.0, 0.0) == math.inf
    assert time_to_collision(0.0, 15.0, 0.0, 25.0, 0.0) == 0.0
    # Equally fast, the leader brakes by 4 m/s²: 32 m = 2 t² after 4 s.
    assert time_to_collision(32.0, 30.0, 0.0, 30.0, -4.0) == pytest.approx(4.0)


@given(st.floats(5.0, 100.0), speeds, st.floats(0.0, 30.0), st.floats(0.1, 10.0))
@settings(max_examples=50)
def test_time_to_collision_falls_with_the_closing_speed(
    gap: float, v: float, v_l: float, more: float
) -> None:
    assume(v > v_l + 0.1)
    assert time_to_collision(gap, v + more, 0.0, v_l, 0.0) < time_to_collision(gap, v, 0.0, v_l, 0.0)


@given(st.sampled_from(MODELS), speeds, st.floats(0.0, 1.0), brakes)
@settings(max_examples=100)
def test_slower_surface_earlier_warning(model: str, v: float, part: float, a_l: float) -> None:
    v_l = v * part
    dry, wet, snow = (distances(model, v, v_l, a_l=a_l, surface=surface) for surface in SURFACES)
    for better, worse in ((dry, wet), (wet, snow)):
        assert worse[0] >= better[0] - 1e-9
        assert worse[1] >= better[1] - 1e-9
    assert all(reminder >= danger >= 0.0 for reminder, danger in (dry, wet, snow))
    assert np.isfinite([*dry, *wet, *snow]).all()


@given(st.sampled_from(("camp", "ttc")), st.floats(15.0, 45.0), st.floats(0.8, 1.0), st.floats(-8.0, -1.0))
@settings(max_examples=60)
def test_harder_braking_leader_earlier_warning(model: str, v: float, part: float, a_l: float) -> None:
    steady, braking = distances(model, v, v * part), distances(model, v, v * part, a_l=a_l)
    assert braking[0] >= steady[0] - 1e-9
    assert braking[1] >= steady[1] - 1e-9


def test_closing_speed_alone_sees_no_danger_in_a_braking_leader() -> None:
    """The trap: equally fast, 15 m behind, and the leader brakes hard. The default reacts at once."""
    assert SafeDistance().model == "camp"
    assert distances("honda", 30.0, 30.0, a_l=-6.0)[0] < 15.0
    assert distances("camp", 30.0, 30.0, a_l=-6.0)[1] > 15.0
    assert distances("camp", 30.0, 30.0)[0] < 5.0  # and leaves steady following alone
