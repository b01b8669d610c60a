"""The observer with a gyroscope and a steering sensor beside the camera."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from manoeuvre import PREVIEW_M, column, drive, lane_change_steer, looks, observed, unseen

from ego_synth.sensors import EgoSensors
from plugin.configuration import configuration_from
from plugin.motion import observer
from plugin.motion.estimate import MotionEstimate, OwnReadings, blank
from plugin.motion.filter import FilterSettings
from plugin.motion.filter_kernels import ALIGNMENT, CALM, GYRO, KRATE, UNREST, YAW, K, N, R, sense
from plugin.motion.observer import ObserverSettings
from plugin.own_motion import OwnSensors
from sumo_net.ego import EgoTruth
from sumo_net.vehicle import Vehicle, steady_state

HALF = Vehicle()
CAMERA = {"offset_m": 0.005, "heading_rad": 4e-4, "curvature_1pm": 2e-5, "curvature_rate_1pm2": 3e-6}
UNCLIPPED = observer.schedule(HALF, PREVIEW_M, ObserverSettings(filter=FilterSettings(clip_sd=1e9)))


@pytest.fixture(scope="module")
def schedule():
    return observer.schedule(HALF, PREVIEW_M, ObserverSettings())


@pytest.fixture(scope="module")
def change():
    return drive(HALF, lane_change_steer(HALF, 25.0), lambda t: 25.0, duration_s=9.0)


def readings(truth, copies, rng=None, yaw_rate_offset=0.0, steer_offset=0.0):
    """Readings step by step, with the default noise of EgoSensors."""
    noise = (
        np.zeros((2, len(truth.time_s), copies))
        if rng is None
        else rng.standard_normal((2, len(truth.time_s), copies))
    )
    return [
        OwnReadings(
            truth.yaw_rate_rps[k] + yaw_rate_offset + 1e-3 * noise[0, k],
            truth.steer_rad[k] + steer_offset + 4e-5 * noise[1, k],
        )
        for k in range(len(truth.time_s))
    ]


@given(
    seed=st.integers(0, 2**32 - 1),
    speed=st.floats(8.0, 70.0),
    yaw_rate=st.floats(-0.5, 0.5),
    steer=st.floats(-0.05, 0.05),
)
def test_both_rows_are_the_textbook_kalman_filter(seed, speed, yaw_rate, steer):
    rng = np.random.default_rng(seed)
    s, c = UNCLIPPED, FilterSettings()
    root = 0.1 * rng.uniform(-1.0, 1.0, (N, N))
    oracle = KalmanFilter(dim_x=N, dim_z=2)
    oracle.x, oracle.P = 0.1 * rng.uniform(-1.0, 1.0, N), root @ root.T + 1e-6 * np.eye(N)
    j, w = int(speed), speed - int(speed)
    H = np.zeros((2, N))
    H[0, [YAW, GYRO]] = 1.0
    H[1, [K, KRATE, R]] = (1 - w) * s.steer[j] + w * s.steer[j + 1]
    H[1, [UNREST, CALM, ALIGNMENT]] = s.quick, -s.quick, 1.0
    oracle.R = np.diag([c.yaw_rate_reading_rps**2, c.steer_reading_rad**2 + (c.steer_scale * steer) ** 2])
    got_x, got_P = oracle.x.copy(), oracle.P.copy()
    sense(got_x, got_P, yaw_rate, steer, j, w, speed, s, np.empty(N), np.empty(N))
    oracle.update(np.array([yaw_rate, steer]), H=H)
    assert got_x == pytest.approx(oracle.x, abs=1e-7)
    assert got_P == pytest.approx(oracle.P, abs=1e-7)
    assert np.linalg.eigvalsh(got_P).min() > -1e-12


def test_without_readings_it_is_the_camera_alone_to_the_bit(schedule, change):
    seen = looks(change, np.random.default_rng(1), 5, **CAMERA)
    nothing = [OwnReadings(np.full(5, np.nan), np.full(5, np.nan))] * len(seen)
    for one, other in zip(
        observed(schedule, change, seen, None)[1], observed(schedule, change, seen, nothing)[1], strict=True
    ):
        for name in MotionEstimate._fields:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_lane_change_is_followed_much_closer_than_by_the_camera_alone(schedule, change):
    rng = np.random.default_rng(2)
    seen, own = looks(change, rng, 100, **CAMERA), readings(change, 100, rng, 2e-3, 1e-3)
    _, alone = observed(schedule, change, seen, None)
    _, fused = observed(schedule, change, seen, own)
    for name, part in (("yaw_rate_rps", 0.03), ("lateral_speed_mps", 0.03), ("steer_rad", 0.08)):
        truth = getattr(change, name)
        errors = [column(rows, name)[20:75] - truth[20:75, None] for rows in (alone, fused)]
        assert errors[1].std() < part * np.abs(truth).max()
        assert errors[1].std() < 0.5 * errors[0].std()


def test_the_sensors_offsets_are_found(schedule):
    def curvature(s):
        return 0.001 * np.sin(s / 120.0)

    def steer(t, x, v):
        per = HALF.wheelbase_m + HALF.understeer * v**2
        return per * (curvature(x[2] + 0.3 * v) - (0.49 * x[3] + 1.1 * (v * x[4] + x[0])) / v**2)

    truth = drive(HALF, steer, lambda t: 25.0, curvature, duration_s=30.0)
    rng = np.random.default_rng(3)
    seen, own = looks(truth, rng, 30, **CAMERA), readings(truth, 30, rng, 4e-3, -2e-3)
    state, rows = observed(schedule, truth, seen, own)
    assert state.x[:, GYRO] == pytest.approx(4e-3, abs=4e-4)
    assert state.x[:, ALIGNMENT] == pytest.approx(-2e-3, abs=2e-4)
    error = column(rows, "yaw_rate_rps")[100:] - truth.yaw_rate_rps[100:, None]
    assert np.sqrt(np.mean(error**2)) < 1e-3
    assert (np.abs(state.x[:, GYRO] - 4e-3) < 4.0 * np.sqrt(state.P[:, GYRO, GYRO])).mean() > 0.9
    # what is known of the gyroscope is what the radar is told while there is no lane
    lost = rows[-1]._replace(yaw_rate_rps=np.full(30, np.nan))
    assert observer.yaw_rate(state, lost, np.full(30, 0.104)) == pytest.approx(0.1, abs=4e-4)


@pytest.mark.parametrize("missing", ["yaw_rate_rps", "steer_rad"])
def test_either_sensor_alone_helps(schedule, change, missing):
    rng = np.random.default_rng(4)
    seen = looks(change, rng, 50, **CAMERA)
    own = [row._replace(**{missing: np.full(50, np.nan)}) for row in readings(change, 50, rng)]
    error = [
        (
            column(observed(schedule, change, seen, one)[1], "yaw_rate_rps")[20:75]
            - change.yaw_rate_rps[20:75, None]
        ).std()
        for one in (None, own)
    ]
    assert error[1] < 0.7 * error[0]


def test_a_wrong_look_leaves_the_motion_alone(schedule, change):
    rng = np.random.default_rng(5)
    seen, own = looks(change, rng, 10, **CAMERA), readings(change, 10, rng)
    wild = list(seen)
    for k in (40, 41):
        wild[k] = seen[k]._replace(
            lateral_offset_m=seen[k].lateral_offset_m + 0.25,
            heading_error_rad=seen[k].heading_error_rad - 0.03,
        )
    _, plain = observed(schedule, change, seen, own)
    _, rows = observed(schedule, change, wild, own)
    assert rows[40].settled_s.max() == 0.0
    for k in (40, 41, 45):
        assert np.abs(rows[k].yaw_rate_rps - plain[k].yaw_rate_rps).max() < 5e-3
        assert np.abs(rows[k].lateral_speed_mps - plain[k].lateral_speed_mps).max() < 0.03


def test_a_new_start_forgets_the_lane_but_neither_motion_nor_offsets(schedule, change):
    rng = np.random.default_rng(6)
    seen, own = looks(change, rng, 10, **CAMERA), readings(change, 10, rng, 3e-3)
    # the lane is another one from step 50 on, by less than a lane's width
    seen[50:] = [look._replace(lateral_offset_m=look.lateral_offset_m + 1.3) for look in seen[50:]]
    state, rows = observed(schedule, change, seen, own)
    error = column(rows, "yaw_rate_rps") - change.yaw_rate_rps[:, None]
    assert np.abs(error[45:60]).max() < 6e-3  # never NaN
    assert rows[60].lateral_offset_m - change.offset_m[60] == pytest.approx(1.3, abs=0.03)
    assert rows[60].settled_s.max() < 1.0
    # no lane for longer than the filter coasts: the offsets stay known
    state, rows = observed(schedule, change, [*seen[:60], *(unseen(look) for look in seen[60:])], own)
    assert np.isnan(rows[-1].yaw_rate_rps).all()
    assert state.x[:, GYRO] == pytest.approx(3e-3, abs=2e-3)
    assert (state.P[:, GYRO, GYRO] < 1.5e-3**2).all()


def test_another_load_is_no_worse_than_for_the_camera_alone():
    vehicle, v, k = Vehicle(mass_kg=1460.0), 80 / 3.6, 0.0036
    steer = k * (vehicle.wheelbase_m + vehicle.understeer * v**2)
    slip, yaw = steady_state(vehicle, v, steer)
    truth = drive(vehicle, lambda *_: steer, lambda t: v, lambda s: k, 8.0, (slip, yaw, 0.0, 0.2, -slip / v))
    schedule = observer.schedule(HALF, PREVIEW_M, ObserverSettings())
    rng = np.random.default_rng(7)
    _, rows = observed(schedule, truth, looks(truth, rng, 20, **CAMERA), readings(truth, 20, rng))
    late = truth.time_s >= 2.0
    assert np.abs(column(rows, "yaw_rate_rps")[late] / yaw - 1.0).max() < 0.05
    assert np.abs(column(rows, "lateral_speed_mps")[late].mean() / slip - 1.0) < 0.22


def test_paper_mode_never_looks_at_them(change):
    schedule = observer.schedule(HALF, PREVIEW_M, ObserverSettings(mode="paper"))
    seen, own = looks(change, np.random.default_rng(1), 3, **CAMERA), readings(change, 3, None, 0.1, 0.1)
    _, alone = observed(schedule, change, seen[:30], None)
    _, rows = observed(schedule, change, seen[:30], own[:30])
    for one, other in zip(alone, rows, strict=True):
        for name in MotionEstimate._fields:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def truth_of(n):
    """An EgoTruth of which the sensors see speed, acceleration, yaw rate and steer."""
    parts = {name: np.zeros(n) for name in EgoTruth._fields}
    parts |= {"speed_mps": np.full(n, 20.0), "acceleration_mps2": np.full(n, -1.0)}
    parts |= {"yaw_rate_rps": np.full(n, 0.1), "steer_rad": np.full(n, 0.01)}
    return EgoTruth(**parts)


def test_unused_sensors_leave_the_observer_the_camera_and_the_rest_the_truth():
    own = OwnSensors(configuration_from({"ego_sensors": {"used": False}}), seed=1)
    _, read = own.step(own.init(["a", "b"]), truth_of(2))
    assert np.isnan(read.observed.yaw_rate_rps).all()
    assert np.isnan(read.observed.steer_rad).all()
    state = observer.init(2, UNCLIPPED)
    rows = own.for_radar(read, state, blank(2))
    for name, value in (("speed_mps", 20.0), ("acceleration_mps2", -1.0), ("yaw_rate_rps", 0.1)):
        assert np.all(getattr(rows, name) == value)


def test_sensors_read_about_the_truth_and_the_observer_gets_the_front_wheels_angle():
    own = OwnSensors(configuration_from({}), seed=1)
    names = [f"v{i}" for i in range(200)]
    _, read = own.step(own.init(names), truth_of(200))
    assert read.observed.steer_rad.mean() == pytest.approx(0.01, abs=3e-4)
    assert read.observed.steer_rad.std() > 5e-4
    assert read.observed.yaw_rate_rps.mean() == pytest.approx(0.1, abs=6e-4)
    assert not np.any(read.readings.speed_mps == 20.0 + 1e-12)
    assert read.readings.speed_mps.std() == pytest.approx(np.hypot(0.001 * 20.0, 0.02), rel=0.2)
    # while there is no lane the radar gets the gyroscope, else what is observed
    motion = blank(200)
    for part in motion[:-1]:
        part[:] = np.nan
    motion.yaw_rate_rps[:100] = 0.07
    yaw_rate = own.for_radar(read, observer.init(200, UNCLIPPED), motion).yaw_rate_rps
    assert np.all(yaw_rate[:100] == 0.07)
    np.testing.assert_array_equal(yaw_rate[100:], read.readings.yaw_rate_rps[100:])


def test_the_filter_takes_the_sensors_for_what_they_are():
    c, s = FilterSettings(), EgoSensors()
    step = 1.0 / np.sqrt(12.0)
    yaw_rate = np.hypot(s.yaw_rate_noise_rps, step * s.yaw_rate_resolution_rps)
    steer = np.hypot(s.steering_noise_rad, step * s.steering_resolution_rad) / s.steering_ratio
    assert c.yaw_rate_reading_rps == pytest.approx(yaw_rate, rel=0.15)
    assert c.steer_reading_rad == pytest.approx(steer, rel=0.15)
    assert c.yaw_rate_offset_rps == pytest.approx(s.yaw_rate_offset_rps, rel=0.15)
    assert c.steer_offset_rad == pytest.approx(s.steering_offset_rad / s.steering_ratio, rel=0.15)
    assert c.yaw_rate_walk == pytest.approx(s.yaw_rate_walk_rps, rel=0.15)
    assert c.steer_walk == pytest.approx(s.steering_walk_rad / s.steering_ratio, rel=0.15)
    assert c.steer_scale == s.steering_scale
