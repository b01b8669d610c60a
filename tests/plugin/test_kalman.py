"""The batched Kalman filter against filterpy, and its models against filterpy's noise matrices."""

import math

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from plugin.tracking import kalman
from plugin.tracking.models import (
    POLAR_ANGLE,
    POLAR_H,
    PUBLISHED_MOTION,
    GroundMotion,
    RadarNoise,
    ground_model,
    markov_powers,
    polar_models,
)

R = RadarNoise().covariance


def random_covariance(rng: np.random.Generator, tracks: int, n: int = 6) -> np.ndarray:
    root = rng.standard_normal((tracks, n, n))
    return root @ root.transpose(0, 2, 1) + 0.1 * np.eye(n)


@pytest.mark.parametrize("kind", ["cv", "ca"])
def test_noise_at_the_stated_step_is_filterpys(kind: str) -> None:
    F, Q = polar_models((kind,), PUBLISHED_MOTION).transition(np.array([0.1]))
    dim = 2 if kind == "cv" else 3
    np.testing.assert_allclose(Q[0, 0, :dim, :dim], Q_discrete_white_noise(dim, 0.1, 0.3**2), rtol=1e-12)
    angular = Q_discrete_white_noise(dim, 0.1, math.radians(0.3) ** 2)
    np.testing.assert_allclose(Q[0, 0, 3 : 3 + dim, 3 : 3 + dim], angular, rtol=1e-12)
    assert not Q[0, 0, :3, 3:].any()
    state = np.array([100.0, -3.0, 2.0, 0.1, 0.01, 0.02])
    expected = [99.7, -3.0, 0.0, 0.101, 0.01, 0.0]
    if kind == "ca":
        expected = [99.7 + 0.01, -2.8, 2.0, 0.101 + 0.0001, 0.012, 0.02]
    np.testing.assert_allclose(F[0, 0] @ state, expected, rtol=1e-12)


def test_noise_grows_alike_in_small_and_in_large_steps() -> None:
    """2 s in steps of 0.02 s or of 0.1 s: as uncertain in the driven state, nearly so in the others."""
    for models in (polar_models(("cv", "ca"), PUBLISHED_MOTION), ground_model(GroundMotion())):
        F, Q = models.transition(np.array([0.02, 0.1]))
        for j, name in enumerate(models.names):
            P = np.zeros((2, 6, 6))
            for step, count in ((0, 100), (1, 20)):
                for _ in range(count):
                    P[step] = F[step, j] @ P[step] @ F[step, j].T + Q[step, j]
            driven = [1, 4] if name == "cv" else [2, 5]
            np.testing.assert_allclose(P[0][driven, driven], P[1][driven, driven], rtol=1e-12)
            np.testing.assert_allclose(np.diag(P[0]), np.diag(P[1]), rtol=0.15)


def test_markov_powers_compose() -> None:
    markov = np.array([[0.98, 0.02], [0.05, 0.95]])
    half, same, double = markov_powers(markov, np.array([0.05, 0.1, 0.2]), 0.1)
    np.testing.assert_allclose(half @ half, markov, atol=1e-12)
    np.testing.assert_array_equal(same, markov)
    np.testing.assert_allclose(double, markov @ markov, atol=1e-12)


def test_equals_filterpy_with_irregular_steps_and_missing_measurements() -> None:
    rng = np.random.default_rng(3)
    tracks, steps = 5, 40
    models = polar_models(("ca",), PUBLISHED_MOTION)
    x, P = rng.standard_normal((tracks, 6)), random_covariance(rng, tracks)
    ours = kalman.Gaussian(x, P)
    theirs = []
    for t in range(tracks):
        one = KalmanFilter(6, 3)
        one.x, one.P, one.H, one.R = x[t, :, None].copy(), P[t].copy(), POLAR_H, R
        theirs.append(one)
    for _ in range(steps):
        dt = rng.choice([0.05, 0.1, 0.37], tracks)
        unique, which = np.unique(dt, return_inverse=True)
        F, Q = models.transition(unique)
        z, seen = rng.standard_normal((tracks, 3)), rng.random(tracks) < 0.7
        ours = kalman.predict(ours, F[:, 0], Q[:, 0], which)
        ours, innovation = kalman.update(ours, z, seen, R)
        for t, one in enumerate(theirs):
            one.predict(F=F[which[t], 0], Q=Q[which[t], 0])
            one.update(z[t, :, None] if seen[t] else None)
            np.testing.assert_allclose(ours.x[t], one.x[:, 0], atol=1e-9, rtol=1e-9)
            np.testing.assert_allclose(ours.P[t], one.P, atol=1e-9, rtol=1e-9)
            if seen[t]:
                np.testing.assert_allclose(innovation.S[t], one.S, atol=1e-9, rtol=1e-9)
                np.testing.assert_allclose(innovation.y[t], one.y[:, 0], atol=1e-9)
                assert innovation.log_likelihood[t] == pytest.approx(one.log_likelihood, rel=1e-9)
            else:
                assert np.isnan(innovation.log_likelihood[t])


def test_angle_innovation_is_wrapped() -> None:
    state = kalman.Gaussian(np.array([[10.0, 0, 0, 3.1, 0, 0]]), np.eye(6)[None])
    z = np.array([[10.0, 0.0, -3.1]])
    _, innovation = kalman.update(state, z, np.array([True]), R, POLAR_ANGLE)
    assert innovation.y[0, 2] == pytest.approx(2 * math.pi - 6.2)


def test_indefinite_covariance_is_told_and_changes_nothing() -> None:
    state = kalman.Gaussian(np.zeros((1, 6)), -10.0 * np.eye(6)[None])
    after, innovation = kalman.update(state, np.ones((1, 3)), np.array([True]), R)
    assert np.isnan(innovation.log_likelihood[0])
    np.testing.assert_array_equal(after.x, state.x)
    np.testing.assert_array_equal(after.P, state.P)


@given(seed=st.integers(0, 2**32 - 1), dt=st.floats(1e-3, 5.0), seen=st.booleans())
@settings(max_examples=25)
def test_covariance_stays_symmetric_and_non_negative(seed: int, dt: float, seen: bool) -> None:
    rng = np.random.default_rng(seed)
    F, Q = polar_models(("cv", "ca"), PUBLISHED_MOTION).transition(np.array([dt]))
    state = kalman.Gaussian(rng.standard_normal((1, 6)), random_covariance(rng, 1))
    for j in (0, 1, 0):
        state = kalman.predict(state, F[:, j], Q[:, j])
        state, _ = kalman.update(state, rng.standard_normal((1, 3)), np.array([seen]), R)
        np.testing.assert_array_equal(state.P, state.P.transpose(0, 2, 1))
        assert np.linalg.eigvalsh(state.P[0]).min() > -1e-12 * np.abs(state.P).max()


@pytest.mark.parametrize(("kind", "states"), [("cv", [0, 1, 3, 4]), ("ca", [0, 1, 2, 3, 4, 5])])
def test_nees_of_the_matched_filter_is_inside_the_95_percent_bounds(kind: str, states: list[int]) -> None:
    """400 runs: the mean normalised error squared at the end of the run, and how often over it."""
    rng = np.random.default_rng(20)
    runs, steps = 400, 150
    F, Q = (
        matrices[0, 0] for matrices in polar_models((kind,), PUBLISHED_MOTION).transition(np.array([0.1]))
    )
    gamma = np.linalg.cholesky(Q[np.ix_([0, 3], [0, 3])])  # one source of noise an axis
    columns = np.zeros((6, 2))
    columns[:3, 0], columns[3:, 1] = Q[:3, 0] / gamma[0, 0], Q[3:, 3] / gamma[1, 1]
    P0 = np.diag([1.0, 0.25, 1.0, 1e-5, 1e-4, 1e-4])
    truth = np.tile([100.0, -3.0, 0.0, 0.03, 0.0, 0.0], (runs, 1))
    start = truth + rng.standard_normal((runs, 6)) * np.sqrt(np.diag(P0))
    if kind == "cv":
        start[:, [2, 5]] = 0.0
        P0[[2, 5], [2, 5]] = 0.0
    state = kalman.Gaussian(start, np.tile(P0, (runs, 1, 1)))
    everyone = np.ones(runs, np.bool_)
    nees = []
    for _ in range(steps):
        truth = truth @ F.T + rng.standard_normal((runs, 2)) @ columns.T
        z = truth @ POLAR_H.T + rng.standard_normal((runs, 3)) * np.sqrt(np.diag(R))
        state = kalman.predict(state, F, Q)
        state, _ = kalman.update(state, z, everyone, R)
        error, P = (truth - state.x)[:, states], state.P[:, states][:, :, states]
        nees.append(np.einsum("ti,ti->t", error, np.linalg.solve(P, error[..., None])[..., 0]))
    low, high = chi2.ppf([0.025, 0.975], len(states) * runs) / runs
    assert low < nees[-1].mean() < high
    inside = [low < one.mean() < high for one in nees]
    assert np.mean(inside) > 0.8  # 0.95 is expected, but the 150 times are one correlated series


def test_other_sizes_are_refused() -> None:
    small = kalman.Gaussian(np.zeros((1, 4)), np.eye(4)[None])
    with pytest.raises(ValueError, match="x has 4 states"):
        kalman.predict(small, np.eye(4), np.eye(4))
    whole = kalman.Gaussian(np.zeros((1, 6)), np.eye(6)[None])
    with pytest.raises(ValueError, match="z has 2 components"):
        kalman.update(whole, np.zeros((1, 2)), np.ones(1, np.bool_), R)
