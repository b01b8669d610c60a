"""The Kalman filter of the default observer: its step, its noise, its table over the speed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from manoeuvre import PREVIEW_M, drive, lane_change_steer, looks, unseen
from scipy.linalg import expm

from plugin.motion import observer
from plugin.motion.filter import FilterSettings, continuous_model, measurement
from plugin.motion.filter_kernels import AIM, GYRO, N, predict, update
from plugin.motion.filter_kernels import R as RESIDUAL
from plugin.motion.observer import ObserverSettings
from sumo_net.vehicle import Vehicle

HALF = Vehicle()
UNCLIPPED = FilterSettings(clip_sd=1e9)
UNCLIPPED_SCHEDULE = observer.schedule(HALF, PREVIEW_M, ObserverSettings(filter=UNCLIPPED))


@pytest.fixture(scope="module")
def change():
    return drive(HALF, lane_change_steer(HALF, 25.0), lambda t: 25.0, duration_s=9.0)


@given(seed=st.integers(0, 2**32 - 1), speed=st.floats(0.0, 70.0))
def test_step_is_the_textbook_kalman_filter_and_keeps_the_covariance(seed, speed):
    rng = np.random.default_rng(seed)
    settings, s = UNCLIPPED, UNCLIPPED_SCHEDULE
    root = 0.1 * rng.uniform(-1.0, 1.0, (N, N))
    P0, x0 = root @ root.T + 1e-6 * np.eye(N), 0.1 * rng.uniform(-1.0, 1.0, N)
    j = int(speed / s.spacing)
    w = speed / s.spacing - j
    new_x, new_P = np.empty(N), np.empty((N, N))
    predict(x0, P0, j, w, s, np.empty((N, N)), np.empty((N, N)), np.empty((N, N)), new_x, new_P)
    F = (1 - w) * s.transition[j] + w * s.transition[j + 1]
    Q = (1 - w) * s.noise[j] + w * s.noise[j + 1]
    want_x, want_P = F @ x0, F @ P0 @ F.T + Q
    assert new_x == pytest.approx(want_x, rel=1e-9, abs=1e-12)
    assert new_P == pytest.approx(want_P, rel=1e-9, abs=1e-12)

    z = np.array([0.1, 0.01, 0.002, 1e-5])
    H, R = measurement(settings, PREVIEW_M)
    gain = want_P @ H.T @ np.linalg.inv(H @ want_P @ H.T + R)
    assert update(new_x, new_P, z, 1.0, 1.0, s, np.empty(N), np.empty(N)) >= 0.0
    assert new_x == pytest.approx(want_x + gain @ (z - H @ want_x), abs=1e-7)
    rest = np.eye(N) - gain @ H
    assert new_P == pytest.approx(rest @ want_P @ rest.T + gain @ R @ gain.T, abs=1e-7)
    assert np.linalg.eigvalsh(new_P).min() > -1e-12


@pytest.mark.parametrize("liveliness", [0.0, 1.0, 2.0])
def test_the_harder_is_steered_the_sooner_it_may_change(change, liveliness):
    """The variance of what is steered for grows by (liveliness · residual)² a second beyond the model's."""
    s = observer.schedule(HALF, PREVIEW_M, ObserverSettings(filter=FilterSettings(liveliness=liveliness)))
    residual = np.array([0.0, 0.5, -2.0, 9.0])
    x = np.zeros((4, N))
    x[:, RESIDUAL] = x[:, AIM] = residual
    known = {"running": np.ones(4, bool), "x": x, "width": np.full(4, 3.75), "age": np.ones(4)}
    dark = unseen(looks(change, None, 4)[0])
    after, _ = observer.step(observer.init(4, s)._replace(**known), s, dark, np.full(4, 25.0))
    steered = np.minimum(np.abs(after.x[:, RESIDUAL]), 3.0)
    assert steered == pytest.approx(np.minimum(np.abs(residual), 3.0), rel=0.1)
    grown = after.P[:, AIM, AIM] - s.noise[25, AIM, AIM]
    assert grown == pytest.approx(0.1 * (liveliness * steered) ** 2, abs=1e-9)


def test_table_between_two_speeds_is_near_the_exact_discretisation():
    s = observer.schedule(HALF, PREVIEW_M, ObserverSettings())
    for v in (5.5, 12.5, 30.5):
        F, _ = continuous_model(HALF, FilterSettings(), v)
        between = 0.5 * (s.transition[int(v)] + s.transition[int(v) + 1])
        assert between[:4, :GYRO] == pytest.approx(expm(0.1 * F)[:4], abs=0.02, rel=0.02)
