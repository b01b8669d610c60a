"""The Sage–Husa filter, safe and as published, against direct formulas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plugin.tracking import adaptive, kalman
from plugin.tracking.models import GROUND_C, GroundMotion, ground_model

F, Q = (m[0, 0] for m in ground_model(GroundMotion()).transition(np.array([0.1])))
R0 = np.diag([1.0, 0.25, 0.1])
B = 0.97


def start(rng: np.random.Generator, tracks: int, prior_steps: float = 0.0) -> adaptive.AdaptiveState:
    P = np.tile(np.diag([1.0, 0.25, 4.0, 0.1, 4.0, 1.0]), (tracks, 1, 1))
    return adaptive.init(rng.standard_normal((tracks, 6)), P, R0, Q, prior_steps)


def test_safe_step_is_the_formula() -> None:
    rng = np.random.default_rng(1)
    state = adaptive.predict_safe(start(rng, 3, prior_steps=2.0), F, Q)
    z = rng.standard_normal((3, 3))
    after = adaptive.update_safe(state, z, np.ones(3, np.bool_), GROUND_C, B)
    d = (1 - B) / (1 - B**3)
    for t in range(3):
        P, H = state.P[t], GROUND_C
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R0)
        x = state.x[t] + K @ (z[t] - H @ state.x[t])
        P = (np.eye(6) - K @ H) @ P
        e = z[t] - H @ x
        np.testing.assert_allclose(after.x[t], x, atol=1e-12)
        np.testing.assert_allclose(after.P[t], P, atol=1e-12)
        np.testing.assert_allclose(after.R[t], (1 - d) * R0 + d * (np.outer(e, e) + H @ P @ H.T), atol=1e-12)
    assert after.k.tolist() == [3.0] * 3


def test_patent_steps_are_the_formulas() -> None:
    """Eqs. (8) to (14) written out plainly for one track, until every covariance has turned indefinite."""
    rng = np.random.default_rng(2)
    state = start(rng, 1)
    x, P, q, Qk = state.x[0], state.P[0], np.zeros(6), Q
    r, R, H = np.zeros(3), R0, GROUND_C
    flags = 0
    for k in range(12):
        z = H @ np.array([20.0 * 0.1 * k, 20.0, 0, 0, 0, 0]) + rng.standard_normal(3) * [1.0, 0.5, 0.3]
        d = (1 - B) / (1 - B ** (k + 1))
        predicted, Pp = F @ x + q, F @ P @ F.T + Qk
        e = z - H @ predicted - r
        S = H @ Pp @ H.T + R
        K = Pp @ H.T @ np.linalg.inv(S)
        x_new, P_new = predicted + K @ e, (np.eye(6) - K @ H) @ Pp
        q = (1 - d) * q + d * (x_new - F @ x)
        Qk = (1 - d) * Qk + d * (np.outer(K @ e, K @ e) + P_new - F @ P @ F.T)
        r = (1 - d) * r + d * (z - H @ predicted)
        R = (1 - d) * R + d * (np.outer(e, e) - H @ Pp @ H.T)
        x, P = x_new, P_new
        state = adaptive.predict_patent(state, F)
        state = adaptive.update_patent(state, z[None], np.array([True]), H, B, True)
        for ours, theirs in zip(state, (x, P, q, Qk, r, R), strict=False):
            np.testing.assert_allclose(ours[0], theirs, rtol=1e-6, atol=1e-8)
        for flag, matrix in (
            (adaptive.R_INDEFINITE, R),
            (adaptive.Q_INDEFINITE, Qk),
            (adaptive.P_INDEFINITE, P),
            (adaptive.S_INDEFINITE, S),
        ):
            indefinite = np.linalg.eigvalsh((matrix + matrix.T) / 2)[0] < -1e-9
            assert bool(state.flags[0] & flag) == indefinite
        flags |= state.flags[0]
    everything = adaptive.R_INDEFINITE | adaptive.Q_INDEFINITE | adaptive.P_INDEFINITE | adaptive.S_INDEFINITE
    assert flags == everything


def test_patent_without_process_adaptation_keeps_q_and_r() -> None:
    rng = np.random.default_rng(3)
    state = adaptive.predict_patent(start(rng, 2), F)
    after = adaptive.update_patent(
        state, rng.standard_normal((2, 3)), np.ones(2, np.bool_), GROUND_C, B, False
    )
    np.testing.assert_array_equal(after.Q, state.Q)
    assert not after.q.any()
    assert not after.r.any()
    assert not np.array_equal(after.R, state.R)


def test_numbers_that_are_lost_are_flagged() -> None:
    state = start(np.random.default_rng(4), 1)
    broken = state._replace(R=np.full((1, 3, 3), np.nan))
    after = adaptive.update_patent(broken, np.ones((1, 3)), np.array([True]), GROUND_C, B, True)
    assert after.flags[0] & adaptive.NOT_FINITE
    after = adaptive.update_patent(state, np.full((1, 3), 1e9), np.array([True]), GROUND_C, B, True)
    assert after.flags[0] & adaptive.NOT_FINITE  # it diverges


@pytest.mark.parametrize("form", ["safe", "patent"])
def test_what_is_not_seen_changes_nothing(form: str) -> None:
    state = start(np.random.default_rng(5), 2)
    nothing, z = np.zeros(2, np.bool_), np.full((2, 3), np.nan)
    if form == "safe":
        after = adaptive.update_safe(state, z, nothing, GROUND_C, B)
    else:
        after = adaptive.update_patent(state, z, nothing, GROUND_C, B, True)
    for ours, before in zip(after, state, strict=True):
        np.testing.assert_array_equal(ours, before)


def test_with_much_prior_and_known_noise_it_is_the_kalman_filter() -> None:
    rng = np.random.default_rng(6)
    state = start(rng, 2, prior_steps=1e9)  # d_k = 1 − b at once
    plain = kalman.Gaussian(state.x, state.P)
    everyone = np.ones(2, np.bool_)
    z = rng.standard_normal((2, 3))
    state = adaptive.update_safe(adaptive.predict_safe(state, F, Q), z, everyone, GROUND_C, 1.0 - 1e-12)
    plain, _ = kalman.update(kalman.predict(plain, F, Q), z, everyone, R0)
    np.testing.assert_allclose(state.x, plain.x, atol=1e-12)
    np.testing.assert_allclose(state.R, np.tile(R0, (2, 1, 1)), atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-3, 1e4), off=st.floats(-1e3, 1e3))
@settings(max_examples=25)
def test_safe_form_stays_definite_whatever_is_measured(seed: int, scale: float, off: float) -> None:
    rng = np.random.default_rng(seed)
    state = start(rng, 2, prior_steps=float(rng.integers(0, 5)))
    for _ in range(20):
        state = adaptive.predict_safe(state, F, Q)
        z = off + scale * rng.standard_normal((2, 3))
        state = adaptive.update_safe(state, z, rng.random(2) < 0.8, GROUND_C, B)
        for matrix in (*state.R, *state.P):
            np.testing.assert_array_equal(matrix, matrix.T)
            assert np.linalg.eigvalsh(matrix)[0] > -1e-12 * np.trace(matrix)
        assert adaptive.innovation_covariance(state, GROUND_C)[1].all()
