"""The batched IMM against filterpy.kalman.IMMEstimator, and its properties."""

import numpy as np
import pytest
from filterpy.kalman import IMMEstimator, KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import expit
from scipy.stats import multivariate_normal

from plugin.tracking import imm, kalman
from plugin.tracking.block_kernels import BLOCK
from plugin.tracking.imm_kernels import expect
from plugin.tracking.models import POLAR_H, PUBLISHED_MOTION, RadarNoise, polar_models

R = RadarNoise().covariance
MARKOV = np.array([[0.98, 0.02], [0.02, 0.98]])


def manoeuvre(rng: np.random.Generator, tracks: int, steps: int) -> np.ndarray:
    """Noisy (r, ṙ, β) of targets that begin to accelerate half-way, (steps, tracks, 3)."""
    t = 0.1 * np.arange(steps)
    after = np.clip(t - t[-1] / 2, 0.0, None)
    truth = np.stack([100 - 3 * t - 0.9 * after**2, -3 - 1.8 * after, 0.03 + 0.009 * after**2], axis=-1)
    return truth[:, None] + rng.standard_normal((steps, tracks, 3)) * np.sqrt(np.diag(R))


def start(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = z @ POLAR_H
    return x, np.tile(np.diag([1.0, 0.25, 1.0, 1e-5, 1e-4, 1e-4]), (len(z), 1, 1))


@pytest.mark.parametrize("kinds", [("cv", "ca"), ("cv", "ca", "ca")])
def test_equals_filterpy(kinds: tuple[str, ...]) -> None:
    r = len(kinds)
    markov = np.full((r, r), 0.02) + np.eye(r) * (1.0 - 0.02 * r)
    if r == 3:
        markov[0] = [0.9, 0.07, 0.03]  # not symmetric: a transposed Π shows
    z = manoeuvre(np.random.default_rng(1), tracks=3, steps=100)
    F, Q = polar_models(kinds, PUBLISHED_MOTION).transition(np.array([0.1]))
    Q = Q.copy()
    Q[:, -1] *= 4.0
    x, P = start(z[0])
    mu = np.full(r, 1 / r)
    state = imm.init(x, P, mu)
    seen = np.ones(3, np.bool_)
    theirs = []
    for t in range(3):
        filters = []
        for j in range(r):
            one = KalmanFilter(6, 3)
            one.x, one.P, one.F, one.Q, one.H, one.R = x[t].copy(), P[t].copy(), F[0, j], Q[0, j], POLAR_H, R
            filters.append(one)
        theirs.append(IMMEstimator(filters, mu, markov))
    for k in range(1, len(z)):
        state = imm.predict(state, F, Q, markov[None])
        state, sound = imm.update(state, z[k], seen, R)
        mean, covariance = imm.combine(state)
        assert sound.all()
        for t, one in enumerate(theirs):
            one.predict()
            one.update(z[k, t])
            np.testing.assert_allclose(mean[t], one.x, atol=1e-9, rtol=1e-9)
            np.testing.assert_allclose(covariance[t], one.P, atol=1e-9, rtol=1e-9)
            np.testing.assert_allclose(state.mu[t], one.mu, atol=1e-9)


def test_identical_models_are_one_filter() -> None:
    z = manoeuvre(np.random.default_rng(2), tracks=4, steps=60)
    F, Q = polar_models(("ca", "ca", "ca"), PUBLISHED_MOTION).transition(np.array([0.1]))
    markov = np.array([[0.7, 0.2, 0.1], [0.3, 0.3, 0.4], [0.05, 0.05, 0.9]])
    x, P = start(z[0])
    state, one = imm.init(x, P, np.array([0.2, 0.5, 0.3])), kalman.Gaussian(x, P)
    seen = np.ones(4, np.bool_)
    for k in range(1, len(z)):
        state, _ = imm.update(imm.predict(state, F, Q, markov[None]), z[k], seen, R)
        one, _ = kalman.update(kalman.predict(one, F[:, 0], Q[:, 0]), z[k], seen, R)
    mean, covariance = imm.combine(state)
    np.testing.assert_allclose(mean, one.x, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(covariance, one.P, rtol=1e-10, atol=1e-12)


def test_the_result_can_take_the_place_of_the_state_or_of_any_other() -> None:
    z = manoeuvre(np.random.default_rng(3), tracks=5, steps=2)
    before = imm.init(*start(z[0]), np.array([0.5, 0.5]))
    seen = np.array([True, True, False, True, False])
    new, sound = imm.update(before, z[1], seen, R)
    other = imm.ImmState(*(np.full_like(part, np.nan) for part in before))
    for out in (other, before):  # `before` last: it is gone then
        given, sound_again = imm.update(before, z[1], seen, R, out=out)
        assert given is out
        assert (sound_again == sound).all()
        for part, expected in zip(given, new, strict=True):
            np.testing.assert_array_equal(part, expected)


def test_without_a_measurement_only_the_markov_step_changes_the_probabilities() -> None:
    F, Q = polar_models(("cv", "ca"), PUBLISHED_MOTION).transition(np.array([0.1]))
    markov = np.array([[0.9, 0.1], [0.3, 0.7]])
    x, P = start(np.array([[50.0, -1.0, 0.0]]))
    state = imm.init(x, P, np.array([0.8, 0.2]))
    state = imm.predict(state, F, Q, markov[None])
    state, sound = imm.update(state, np.full((1, 3), np.nan), np.array([False]), R)
    np.testing.assert_allclose(state.mu[0], [0.8 * 0.9 + 0.2 * 0.3, 0.8 * 0.1 + 0.2 * 0.7], rtol=1e-14)
    assert sound.all()


def test_likelihoods_that_underflow_still_give_probabilities() -> None:
    """A measurement 10,000 m off: exp of every likelihood is 0, yet their ratio is kept."""
    F, Q = polar_models(("cv", "ca"), PUBLISHED_MOTION).transition(np.array([0.1]))
    x, P = start(np.array([[50.0, -1.0, 0.0]]))
    prior = imm.predict(imm.init(x, P, np.array([0.5, 0.5])), F, Q, MARKOV[None])
    z = np.array([1e4, -1.0, 0.0])
    state, sound = imm.update(prior, z[None], np.array([True]), R)
    logs = [
        multivariate_normal(POLAR_H @ prior.x[0, j], POLAR_H @ prior.P[0, j] @ POLAR_H.T + R).logpdf(z)
        for j in range(2)
    ]
    assert max(logs) < -1e6
    assert sound.all()
    assert state.mu[0, 1] == pytest.approx(expit(logs[1] - logs[0]), rel=1e-6)


def test_a_mode_at_probability_zero_is_revived_by_the_markov_step() -> None:
    F, Q = polar_models(("cv", "ca"), PUBLISHED_MOTION).transition(np.array([0.1]))
    x, P = start(np.array([[50.0, -1.0, 0.0]]))
    state = imm.predict(imm.init(x, P, np.array([1.0, 0.0])), F, Q, MARKOV[None])
    np.testing.assert_allclose(state.mu[0], [0.98, 0.02])
    stuck = imm.predict(imm.init(x, P, np.array([1.0, 0.0])), F, Q, np.eye(2)[None])
    for j in range(2):  # a model that cannot be reached goes on by itself
        np.testing.assert_allclose(stuck.x[0, j], F[0, j] @ x[0])
        np.testing.assert_allclose(stuck.P[0, j], F[0, j] @ P[0] @ F[0, j].T + Q[0, j], atol=1e-15)


def test_the_expected_measurement_is_that_of_the_mixture() -> None:
    z = manoeuvre(np.random.default_rng(8), tracks=3, steps=30)
    F, Q = polar_models(("cv", "ca"), PUBLISHED_MOTION).transition(np.array([0.1]))
    state = imm.init(*start(z[0]), np.array([0.5, 0.5]))
    for k in range(1, len(z)):
        state = imm.predict(state, F, Q, MARKOV[None])
        state, _ = imm.update(state, z[k], np.ones(3, np.bool_), R)
    state.x[:, 1] += 1.0  # the models differ, so that their spread counts
    mean, covariance = imm.combine(state)
    expected, S = expect(3, *state, R)
    np.testing.assert_allclose(expected, mean @ POLAR_H.T, rtol=1e-12)
    np.testing.assert_allclose(S, POLAR_H @ covariance @ POLAR_H.T + R, rtol=1e-12)


def test_a_broken_covariance_is_flagged() -> None:
    F, Q = polar_models(("cv", "ca"), PUBLISHED_MOTION).transition(np.array([0.1]))
    x, P = start(np.array([[50.0, -1.0, 0.0], [50.0, -1.0, 0.0]]))
    P[1] *= -1e6
    state = imm.predict(imm.init(x, P, np.array([0.5, 0.5])), F, Q, MARKOV[None])
    state, sound = imm.update(state, x @ POLAR_H.T, np.ones(2, np.bool_), R)
    assert sound.tolist() == [True, False]
    np.testing.assert_allclose(state.mu.sum(axis=1), 1.0)


def test_a_track_in_a_block_is_what_it_is_alone() -> None:
    """Some tracks without a measurement, two with a broken covariance of one model: no other feels it."""
    rng = np.random.default_rng(9)
    tracks = 2 * BLOCK + 5
    x, P = start(manoeuvre(rng, tracks, 1)[0])
    F = polar_models(("ca",), PUBLISHED_MOTION).transition(np.array([0.1]))[0][0]
    P = kalman.predict(kalman.Gaussian(x, P), F, rng.random((tracks, 1, 1)) * P).P
    state = imm.init(x, P, np.array([0.3, 0.7]))
    broken = np.array([3, BLOCK + 1])
    state.P[broken, 1, 0, 0] = -5.0
    z, seen = manoeuvre(rng, tracks, 1)[0], rng.random(tracks) < 0.8
    seen[broken] = True
    together, sound = imm.update(state, z, seen, R)
    assert np.flatnonzero(~sound).tolist() == broken.tolist()
    np.testing.assert_array_equal(together.mu[broken], state.mu[broken])
    for t in range(tracks):
        for j in range(2):
            alone = kalman.Gaussian(state.x[t : t + 1, j], state.P[t : t + 1, j])
            alone, _ = kalman.update(alone, z[t : t + 1], seen[t : t + 1], R)
            np.testing.assert_array_equal(together.x[t, j], alone.x[0])
            np.testing.assert_array_equal(together.P[t, j], alone.P[0])


def test_order_and_size_of_the_batch_change_nothing() -> None:
    z = manoeuvre(np.random.default_rng(4), tracks=6, steps=20)
    F, Q = polar_models(("cv", "ca"), PUBLISHED_MOTION).transition(np.array([0.1]))
    order = np.array([4, 2, 5])
    results = []
    for rows in (np.arange(6), order):
        state = imm.init(*start(z[0, rows]), np.array([0.5, 0.5]))
        for k in range(1, len(z)):
            state = imm.predict(state, F, Q, MARKOV[None])
            state, _ = imm.update(state, z[k, rows], np.ones(len(rows), np.bool_), R)
        results.append(state)
    for full, part in zip(*results, strict=True):
        np.testing.assert_array_equal(full[order], part)


@pytest.mark.parametrize("markov", [[[0.9, 0.2], [0.1, 0.9]], [[1.1, -0.1], [0, 1]], [[1.0]]])
def test_a_matrix_that_is_not_stochastic_is_refused(markov: list[list[float]]) -> None:
    with pytest.raises(ValueError, match="markov = "):
        imm.check_markov(np.array(markov), 2)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_covariances_stay_symmetric_and_non_negative(seed: int) -> None:
    rng = np.random.default_rng(seed)
    models = polar_models(("cv", "ca"), PUBLISHED_MOTION)
    z = manoeuvre(rng, tracks=2, steps=15)
    state = imm.init(*start(z[0]), np.array([0.5, 0.5]))
    for k in range(1, len(z)):
        F, Q = models.transition(rng.uniform(0.01, 1.0, 1))
        state = imm.predict(state, F, Q, MARKOV[None])
        state, _ = imm.update(state, z[k], rng.random(2) < 0.6, R)
        _, covariance = imm.combine(state)
        for P in (*state.P.reshape(-1, 6, 6), *covariance):
            np.testing.assert_array_equal(P, P.T)
            assert np.linalg.eigvalsh(P).min() > -1e-12 * np.abs(P).max()
        np.testing.assert_allclose(state.mu.sum(axis=1), 1.0)
