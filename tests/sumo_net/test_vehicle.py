"""The single-track model: the corrected equations (11) and (21), the checked figures, discretisation."""

import numpy as np
import pytest
from filterpy.common import van_loan_discretization
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sumo_net.vehicle import (
    Vehicle,
    derivatives,
    model,
    preview_model,
    single_track,
    steady_state,
    steer_correction,
    zero_order_hold,
)

HALF_LOAD = Vehicle()
SPEEDS = st.floats(2.0, 60.0)


def as_printed(vehicle: Vehicle, v: float) -> np.ndarray:
    """Matrix A of (21) with the print's errors: no −v in the first row, a difference in the second."""
    A = single_track(vehicle, v)[0].copy()
    p = model(vehicle)
    A[0, 1] = (p.l_r * p.k_r - p.l_f * p.k_f) / (p.m * v)
    A[1, 1] = (p.l_r**2 * p.k_r - p.l_f**2 * p.k_f) / (p.I * v)
    return A


@pytest.mark.parametrize(
    ("kmh", "lateral_speed", "yaw_rate"),
    [(80.0, -1.413, 0.4002), (88.0, -1.864, 0.4146), (90.0, -1.984, 0.4176)],
)
def test_steady_states_as_checked(kmh: float, lateral_speed: float, yaw_rate: float) -> None:
    v_y, gamma = steady_state(HALF_LOAD, kmh / 3.6, 0.05)
    assert v_y == pytest.approx(lateral_speed, abs=6e-4)
    assert gamma == pytest.approx(yaw_rate, abs=6e-5)


def test_steer_correction_at_half_load() -> None:
    assert steer_correction(HALF_LOAD, 1.0) - 1.0 == pytest.approx(0.000843, abs=5e-7)
    assert steer_correction(HALF_LOAD, 20.0) == pytest.approx(1.0 + 0.000843 * 400.0, abs=2e-4)


@settings(max_examples=20)
@given(SPEEDS, st.floats(-0.05, 0.05))
def test_steer_correction_is_the_steady_state_s(v: float, steer: float) -> None:
    """Eq. (13): a curvature K needs the steer f L K."""
    _, yaw_rate = steady_state(HALF_LOAD, v, steer)
    needed = HALF_LOAD.wheelbase_m * yaw_rate / v * steer_correction(HALF_LOAD, v)
    assert needed == pytest.approx(steer, abs=1e-9)


def test_the_model_is_stable_and_the_print_is_not() -> None:
    v = 88.0 / 3.6
    assert np.linalg.eigvals(single_track(HALF_LOAD, v)[0]).real.max() < -1.0
    assert np.linalg.eigvals(as_printed(HALF_LOAD, v)).real.max() == pytest.approx(0.38, abs=0.005)


@settings(max_examples=30)
@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-0.3, 0.3), SPEEDS)
def test_derivatives_are_the_matrices(v_y: float, yaw_rate: float, steer: float, v: float) -> None:
    A, B = single_track(HALF_LOAD, v)
    expected = A @ [v_y, yaw_rate] + B[:, 0] * steer
    assert derivatives(v_y, yaw_rate, steer, v, model(HALF_LOAD)) == pytest.approx(expected, abs=1e-9)


def test_preview_model_is_the_geometry_of_a_circle_ahead() -> None:
    """Eq. (21): y_L, e_L of a straight road, seen from a car that turns, against plane geometry."""
    v, preview, yaw_rate, v_y, h = 20.0, 33.5, 0.1, -0.3, 1e-6
    A, B = preview_model(HALF_LOAD, v, preview)

    def seen(x: float, y: float, heading: float) -> np.ndarray:
        # A straight road y = 0: lateral distance to it at the preview point, across the car's axis.
        return np.array([-(y + preview * np.sin(heading)) / np.cos(heading), -heading])

    before = seen(0.0, 0.0, 0.02)
    x = (v * np.cos(0.02) - v_y * np.sin(0.02)) * h
    y = (v * np.sin(0.02) + v_y * np.cos(0.02)) * h
    rate = (seen(x, y, 0.02 + yaw_rate * h) - before) / h
    model_rate = (A @ [v_y, yaw_rate, *before])[2:]
    assert rate == pytest.approx(model_rate, abs=2e-2)  # small angles: the second order is left out
    assert B[3, 1] == v


@settings(max_examples=15)
@given(SPEEDS)
def test_hold_against_van_loan(v: float) -> None:
    A, B = preview_model(HALF_LOAD, v, 33.5)
    transition, _ = zero_order_hold(A, B, 0.1)
    expected, _ = van_loan_discretization(A, np.zeros((4, 1)), 0.1)
    assert transition == pytest.approx(expected, abs=1e-9)


def test_hold_against_integration() -> None:
    A, B = preview_model(HALF_LOAD, 25.0, 33.5)
    transition, held = zero_order_hold(A, B, 0.1)
    x, u = np.array([0.2, -0.1, 0.5, 0.01]), np.array([0.02, 0.001])
    done = solve_ivp(lambda _, x: A @ x + B @ u, (0.0, 0.1), x, rtol=1e-10, atol=1e-12)
    assert transition @ x + held @ u == pytest.approx(done.y[:, -1], abs=1e-9)


def test_a_vehicle_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="mass_kg"):
        Vehicle(mass_kg=0.0)
