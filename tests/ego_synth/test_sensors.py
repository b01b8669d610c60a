"""The vehicle's own sensors: statistics against settings, determinism."""

import dataclasses
import math

import numpy as np
import pytest

from ego_synth import sensors
from ego_synth.sensors import EgoSensors, Readings
from sumo_net.settings import SettingsError, read

PERFECT = {
    field.name: 0.0
    for field in dataclasses.fields(EgoSensors)
    if field.name not in ("used", "steering_ratio")
}
NAMES = [f"car{i}" for i in range(400)]


def readings(
    settings, steps=50, names=NAMES, seed=1, speed=20.0, acceleration=0.5, yaw_rate=0.05, steer=0.004
):
    state = sensors.init(settings, seed, names)
    truth = [np.full(len(names), value) for value in (speed, acceleration, yaw_rate, steer)]
    rows = []
    for _ in range(steps):
        state, row = sensors.read(settings, state, *truth)
        rows.append(row)
    return Readings(*(np.array(parts) for parts in zip(*rows, strict=True)))  # (steps, n)


def test_perfect_sensors_read_the_truth():
    got = readings(EgoSensors(**PERFECT), steps=2)
    assert got.speed_mps == pytest.approx(20.0)
    assert got.acceleration_mps2 == pytest.approx(0.5)
    assert got.yaw_rate_rps == pytest.approx(0.05)
    assert got.steering_wheel_rad == pytest.approx(16.0 * 0.004)


@pytest.mark.parametrize(
    ("setting", "column", "value"),
    [
        ("yaw_rate_noise_rps", "yaw_rate_rps", 0.002),
        ("steering_noise_rad", "steering_wheel_rad", 0.01),
        ("speed_noise_mps", "speed_mps", 0.05),
        ("acceleration_noise_mps2", "acceleration_mps2", 0.1),
    ],
)
def test_noise_is_white_and_as_large_as_set(setting, column, value):
    got = getattr(readings(EgoSensors(**(PERFECT | {setting: value}))), column)
    error = got - got.mean()
    assert error.std() == pytest.approx(value, rel=0.03)
    assert abs(np.mean(error[1:] * error[:-1])) < 0.03 * value**2
    assert abs(np.mean(error[:, 1:] * error[:, :-1])) < 0.03 * value**2  # between vehicles


@pytest.mark.parametrize(
    ("setting", "column", "value", "of_one"),
    [
        ("yaw_rate_offset_rps", "yaw_rate_rps", 0.002, 0.002),
        ("steering_offset_rad", "steering_wheel_rad", 0.02, 0.02),
        ("steering_scale", "steering_wheel_rad", 0.02, 0.02 * 16.0 * 0.004),
        ("speed_scale", "speed_mps", 0.01, 0.01 * 20.0),
        ("acceleration_offset_mps2", "acceleration_mps2", 0.2, 0.2),
    ],
)
def test_offset_and_scale_are_the_vehicles_own(setting, column, value, of_one):
    got = getattr(readings(EgoSensors(**(PERFECT | {setting: value})), steps=3), column)
    np.testing.assert_array_equal(got[0], got[-1])
    assert got[0].std() == pytest.approx(of_one, rel=0.12)  # 400 vehicles: 3.5 %


@pytest.mark.parametrize(
    ("setting", "column", "value"),
    [("yaw_rate_walk_rps", "yaw_rate_rps", 1e-3), ("steering_walk_rad", "steering_wheel_rad", 1e-3)],
)
def test_offsets_wander_with_the_root_of_time(setting, column, value):
    got = getattr(readings(EgoSensors(**(PERFECT | {setting: value})), steps=101), column)
    assert (got[100] - got[0]).std() == pytest.approx(value * math.sqrt(10.0), rel=0.12)
    assert (got[26] - got[1]).std() == pytest.approx(value * math.sqrt(2.5), rel=0.12)


@pytest.mark.parametrize(
    ("setting", "column", "value"),
    [
        ("yaw_rate_resolution_rps", "yaw_rate_rps", 0.0012),
        ("steering_resolution_rad", "steering_wheel_rad", 0.002),
        ("speed_resolution_mps", "speed_mps", 0.01),
        ("acceleration_resolution_mps2", "acceleration_mps2", 0.02),
    ],
)
def test_readings_are_whole_steps_of_the_resolution(setting, column, value):
    got = getattr(readings(dataclasses.replace(EgoSensors(), **{setting: value}), steps=20), column)
    steps = got / value
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    exact = getattr(readings(dataclasses.replace(EgoSensors(), **{setting: 0.0}), steps=20), column)
    assert np.abs(got - exact).max() <= 0.5 * value + 1e-9


def test_standing_wheels_are_seen_to_stand():
    got = readings(EgoSensors(), speed=0.0)
    assert np.all(got.speed_mps == 0.0)
    assert np.all(readings(EgoSensors(), speed=0.01).speed_mps >= 0.0)


def test_a_vehicle_reads_the_same_whoever_drives_beside():
    alone = readings(EgoSensors(), names=["car7"])
    among = readings(EgoSensors())
    again = readings(EgoSensors())
    other = readings(EgoSensors(), seed=2)
    for one, many, same, differs in zip(alone, among, again, other, strict=True):
        np.testing.assert_array_equal(one[:, 0], many[:, 7])
        np.testing.assert_array_equal(many, same)
        assert not np.array_equal(many, differs)


def test_unused_sensors_are_without_error_and_without_a_steering_wheel():
    got = readings(EgoSensors(used=False), steps=2)
    assert np.all(got.speed_mps == 20.0)
    assert np.all(got.acceleration_mps2 == 0.5)
    assert np.all(got.yaw_rate_rps == 0.05)
    assert np.isnan(got.steering_wheel_rad).all()


def test_settings_say_what_is_wrong():
    with pytest.raises(SettingsError, match="steering_ratio = 0"):
        read(EgoSensors, {"steering_ratio": 0}, "x.toml")
    with pytest.raises(SettingsError, match="did you mean 'speed_scale'"):
        read(EgoSensors, {"speed_scal": 0.1}, "x.toml")
