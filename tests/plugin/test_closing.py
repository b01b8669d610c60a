"""The closing filter: against a plain Kalman filter, and on leaders whose motion is known."""

import numpy as np
import pytest
from pydantic import ValidationError

from camera_synth.camera import Camera, projection
from plugin.tracking.closing import Closing, ClosingFilter, ClosingState
from plugin.tracking.detections import Detections, Estimate, SensorMotion
from plugin.tracking.models import RadarNoise
from plugin.tracking.rear_view import RearView, nothing_seen
from plugin.tracking.tracker import TrackList

P = projection(Camera())
NOISE, MOUNT_M, WIDTH_M = RadarNoise(), 1.6, 1.8
IN_PATH = 5  # the track's id


def make(**options: object) -> ClosingFilter:
    return ClosingFilter(Closing(**options), NOISE, MOUNT_M, P)


def track_list(r: np.ndarray, rate: np.ndarray, own: np.ndarray) -> TrackList:
    """One track straight ahead of each of n vehicles, with its own detection."""
    n, zero = len(r), np.zeros(len(r))
    estimate = Estimate(r, rate, zero, r + MOUNT_M, zero, own + rate, zero, zero, zero, zero)
    ids, yes = np.full(n, IN_PATH), np.ones(n, bool)
    return TrackList(
        np.arange(n), ids, ids - 100, yes, np.arange(n), np.zeros(n, np.int8), np.zeros(n, np.int64), estimate
    )


def follow(
    filter_: ClosingFilter,
    own: np.ndarray,
    z: np.ndarray,
    width_px: np.ndarray | None = None,
    doubt_px: float = 0.0,
) -> tuple[list[ClosingState], np.ndarray, np.ndarray]:
    """States, range and rate (steps, n) from own speeds (steps, n), z (steps, n, 2), width_px (steps, n)."""
    state, states, ranges, rates = filter_.init(), [], [], []
    for k in range(len(own)):
        n = len(own[k])
        tracks = track_list(z[k, :, 0], z[k, :, 1], own[k])
        detections = Detections(np.arange(n), z[k, :, 0], z[k, :, 1], np.zeros(n), np.full(n, -1))
        zero = np.zeros(n)
        view = nothing_seen(n)
        if width_px is not None:
            seen = np.isfinite(width_px[k])
            view = RearView(np.where(seen, IN_PATH, -1), zero, width_px[k], zero + doubt_px)
        sensor = SensorMotion(own[k], zero, zero, zero, zero)
        state, better = filter_.step(state, tracks, detections, sensor, view, np.full((n, 1), IN_PATH), 0.1)
        states.append(ClosingState(*(part.copy() for part in state)))
        ranges.append(better.estimate.range_m)
        rates.append(better.estimate.range_rate_mps)
    return states, np.array(ranges), np.array(rates)


def braking(n: int, steps: int = 60, start_m: float = 30.0, brake: float = 5.0) -> tuple[np.ndarray, ...]:
    """Own speed, true range and range rate (steps, n): the leader brakes from 25 m/s after 2 s."""
    t = 0.1 * np.arange(steps)
    braked = np.maximum(t - 2.0, 0.0)
    leader = np.maximum(25.0 - brake * braked, 0.0)
    rate = np.repeat((leader - 25.0)[:, None], n, axis=1)
    r = start_m - 0.5 * brake * braked**2
    return np.full((steps, n), 25.0), np.repeat(r[:, None], n, axis=1), rate


def test_one_model_without_camera_is_a_plain_kalman_filter() -> None:
    rng, steps, sigma, time = np.random.default_rng(1), 40, 3.0, 2.0
    own, r, rate = braking(1, steps, 60.0)
    own = own + 2.0 * np.sin(0.1 * np.arange(steps))[:, None]
    z = np.stack([r, rate], axis=2) + rng.normal(size=(steps, 1, 2)) * [0.5, 0.3]
    states, _, _ = follow(make(acceleration_mps2=(sigma,), time_s=(time,), camera=False), own, z)
    x, S = states[0].x[0, 0, :3].copy(), states[0].P[0, 0, :3, :3].copy()
    e = np.exp(-0.1 / time)
    F = np.array([[1.0, 0.1, 0.005], [0.0, 1.0, 0.1], [0.0, 0.0, e]])
    g = np.array([0.01 / 6, 0.05, 1.0])
    Q, H, R = sigma**2 * (1 - e**2) * np.outer(g, g), np.eye(2, 3), np.diag([1.0, 0.25])
    for k in range(1, steps):
        x = F @ x - np.array([0.05 * (own[k, 0] + own[k - 1, 0]), 0.0, 0.0])
        S = F @ S @ F.T + Q
        K = S @ H.T @ np.linalg.inv(H @ S @ H.T + R)
        x = x + K @ (z[k, 0] + [0.0, own[k, 0]] - H @ x)
        S = (np.eye(3) - K @ H) @ S
        assert states[k].x[0, 0, :3] == pytest.approx(x, abs=1e-9)
        assert states[k].P[0, 0, :3, :3] == pytest.approx(S, abs=1e-9)


def errors(r: np.ndarray, rate: np.ndarray, found: np.ndarray, found_rate: np.ndarray) -> tuple[float, float]:
    """95th percentile of the error of the time to collision under 3 s, RMS error of the rate."""
    ttc = r / np.maximum(-rate, 1e-9)
    near = (ttc < 3.0) & (r > 3.0)
    error = np.abs(found / np.maximum(-found_rate, 1e-9) - ttc)[near]
    return float(np.quantile(error, 0.95)), float(np.sqrt(np.mean((found_rate - rate)[near] ** 2)))


def test_the_camera_makes_the_time_to_collision_better_even_of_a_body_thought_wider() -> None:
    rng = np.random.default_rng(2)
    own, r, rate = braking(200)
    z = np.stack([r, rate], axis=2) + rng.normal(size=(*r.shape, 2)) * [1.0, 0.5]
    width = P.focal * WIDTH_M / (r + MOUNT_M) * (1.0 + 0.0015 * rng.normal(size=r.shape))
    _, *radar = follow(make(camera=False), own, z)
    _, *both = follow(make(), own, z, width)
    _, *scaled = follow(make(), own, z, 1.1 * width)  # as of a wider body
    (ttc_radar, rate_radar), (ttc_both, rate_both) = errors(r, rate, *radar), errors(r, rate, *both)
    assert ttc_both < 0.9 * ttc_radar
    assert rate_both < 0.9 * rate_radar
    assert errors(r, rate, *scaled)[0] == pytest.approx(ttc_both, rel=0.15)


def test_of_a_leader_that_goes_on_braking_the_closing_speed_does_not_lag() -> None:
    """Two models whose accelerations fade had it 0.3 m/s too low all along."""
    rng = np.random.default_rng(5)
    own, r, rate = braking(100, 55, 40.0, 4.0)
    z = np.stack([r, rate], axis=2) + rng.normal(size=(*r.shape, 2)) * [1.0, 0.5]
    width = P.focal * WIDTH_M / (r + MOUNT_M) + 0.07 * rng.normal(size=r.shape)
    _, _, found = follow(make(), own, z, width)
    _, _, fading = follow(make(acceleration_mps2=(0.5, 8.0), time_s=(2.0, 2.0)), own, z, width)
    lag, before = (np.abs((one - rate)[35:50].mean()) for one in (found, fading))
    assert lag < 0.05
    assert lag < 0.6 * before


def test_a_doubtful_width_counts_for_less() -> None:
    """Widths off by 2 px, as of a body whose flank comes into view, were taken for exact."""
    rng = np.random.default_rng(6)
    own, r, rate = braking(200)
    z = np.stack([r, rate], axis=2) + rng.normal(size=(*r.shape, 2)) * [1.0, 0.5]
    width = P.focal * WIDTH_M / (r + MOUNT_M) + 2.0 * rng.normal(size=r.shape)
    _, *exact = follow(make(), own, z, width)
    _, *doubted = follow(make(), own, z, width, 2.0)
    (ttc_exact, rate_exact), (ttc_doubted, rate_doubted) = (errors(r, rate, *one) for one in (exact, doubted))
    assert ttc_doubted < 0.9 * ttc_exact
    assert rate_doubted < 0.9 * rate_exact


def test_settings_name_what_does_not_fit() -> None:
    with pytest.raises(ValidationError, match="time_s"):
        make(acceleration_mps2=(0.5, 8.0), time_s=(2.0,))
    with pytest.raises(ValidationError, match="time_s"):
        make(acceleration_mps2=(0.5,), time_s=(0.0,))


def test_another_body_s_width_is_dropped_and_a_width_learned_wrongly_is_forgotten() -> None:
    steps = 40
    own, r, rate = braking(1, steps, 30.0, 0.0)
    z = np.stack([r, rate], axis=2)
    right = P.focal * WIDTH_M / (r + MOUNT_M)
    width = right.copy()
    width[20] *= 1.3  # once
    states, found, _ = follow(make(), own, z, width)
    assert found[20:22] == pytest.approx(r[20:22], abs=0.05)
    width[:20], width[20:] = 1.3 * right[:20], right[20:]
    states, found, _ = follow(make(), own, z, width)
    assert states[19].x[0, :, 3] == pytest.approx(1.3 * WIDTH_M, abs=0.1)
    assert states[-1].x[0, :, 3] == pytest.approx(WIDTH_M, abs=0.1)
    assert np.abs(found - r).max() < 0.5


def test_leaders_go_with_their_vehicles_and_tracks() -> None:
    rng = np.random.default_rng(3)
    own, r, rate = braking(3, 10)
    z = np.stack([r, rate], axis=2) + rng.normal(size=(*r.shape, 2))
    filter_ = make()
    state = follow(filter_, own, z)[0][-1]
    turned = filter_.reindex(state, np.array([2, -1, 0]))
    assert turned.owner.tolist() == [0, 2]
    assert (turned.x == state.x[[2, 0]]).all()
    tracks = track_list(z[-1, :, 0], z[-1, :, 1], own[-1])
    gone = tracks._replace(track_id=np.array([IN_PATH, 9, IN_PATH]))
    zero = np.zeros(3)
    detections = Detections(np.arange(3), z[-1, :, 0], z[-1, :, 1], zero, np.full(3, -1))
    sensor = SensorMotion(own[-1], zero, zero, zero, zero)
    nobody = np.full((3, 1), -1)
    after, better = filter_.step(state, gone, detections, sensor, nothing_seen(3), nobody, 0.1)
    assert after.owner.tolist() == [0, 2]
    assert better.estimate.range_m[1] == z[-1, 1, 0]  # not a leader: the track's own value
    assert better.estimate.range_m[0] != z[-1, 0, 0]
    empty = filter_.reindex(filter_.init(), np.array([-1, -1]))
    assert len(empty.owner) == 0
