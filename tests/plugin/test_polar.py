"""The polar filters' prediction of straight motion, and the states of new tracks, by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plugin.tracking import imm
from plugin.tracking.detections import Detections, Estimate, SensorMotion
from plugin.tracking.filters import FilterSettings, make
from plugin.tracking.polar_kernels import bend, first_velocity

STRAIGHT = np.eye(6)  # F of constant rates over H_S
H_S = 0.3
STRAIGHT[0, 1] = STRAIGHT[3, 4] = H_S


def sensor(vx=0.0, vy=0.0, ax=0.0, ay=0.0, yaw_rate=0.0):
    return SensorMotion(*(np.array([float(part)]) for part in (vx, vy, ax, ay, yaw_rate)))


def bent(x, motion):
    """The state after `bend`, and its Jacobian."""
    after, G = np.array(x, float), np.eye(6)
    bend(after, G, H_S, motion, 0)
    return after, G


STATES = st.tuples(st.floats(5, 150), st.floats(-40, 20), st.floats(-1, 1), st.floats(-0.3, 0.3))
MOTIONS = st.builds(sensor, ax=st.floats(-8, 3), ay=st.floats(-4, 4), yaw_rate=st.floats(-0.4, 0.4))


@given(STATES, MOTIONS)
def test_an_object_that_drives_straight_on_is_predicted_exactly(state, motion):
    r, rate, azimuth, turning = state
    c, s = math.cos(azimuth), math.sin(azimuth)
    place, speed = r * np.array([c, s]), rate * np.array([c, s]) + r * turning * np.array([-s, c])
    pull = np.array([motion.ax[0], motion.ay[0]])  # in the axes of before, which do not turn
    x, y = place + speed * H_S - 0.5 * pull * H_S**2
    u, w = speed - pull * H_S
    after = STRAIGHT @ bent([r, rate, 0.0, azimuth, turning, 0.0], motion)[0]
    if math.hypot(x, y) > 1.0:
        distance = math.hypot(x, y)
        assert after[0] == pytest.approx(distance)
        assert after[1] == pytest.approx((x * u + y * w) / distance)
        assert math.remainder(after[3] - math.atan2(y, x) + H_S * motion.yaw_rate[0], math.tau) == (
            pytest.approx(0.0, abs=1e-9)
        )
        assert after[4] == pytest.approx((x * w - y * u) / distance**2)


@given(STATES, MOTIONS)
def test_its_jacobian_is_that_of_small_differences(state, motion):
    r, rate, azimuth, turning = state
    x = np.array([r + 15.0, rate, 0.0, azimuth, turning, 0.0])  # it stays ahead
    _, G = bent(x, motion)
    for column, step in ((0, 1e-4), (1, 1e-4), (4, 1e-6)):
        up, down = x.copy(), x.copy()
        up[column] += step
        down[column] -= step
        numeric = (bent(up, motion)[0] - bent(down, motion)[0]) / (2.0 * step)
        np.testing.assert_allclose(G[:, column], numeric, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("yaw_rate", [0.0, 0.2])
def test_velocity_of_a_new_object(yaw_rate):
    # 20 m/s along x, met by a sensor at 30 m/s: seen ahead all of it, seen across nothing
    azimuth = np.array([0.0, 0.5, math.pi / 2])
    c, s = np.cos(azimuth), np.sin(azimuth)
    motion = sensor(vx=30.0, yaw_rate=yaw_rate)
    vx, vy, spread = first_velocity(np.zeros(3, np.int64), -10.0 * c, c, s, motion, 2.0)
    assert vx == pytest.approx([20.0, 20.0, 0.0], abs=1e-9)
    assert vy == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert spread[:2] == pytest.approx(2.0 / c[:2])
    moving_across = first_velocity(np.zeros(1, np.int64), np.array([7.0]), c[2:], s[2:], motion, 2.0)
    assert moving_across[:, 0] == pytest.approx([0.0, 7.0, 2.0 + 7.0], abs=1e-9)


def test_a_new_track_is_as_uncertain_as_its_detection():
    c = FilterSettings(mount_forward_m=1.5)
    one = Detections(np.zeros(1, np.int64), *np.array([[40.0], [-10.0], [0.1]]), np.full(1, -1, np.int64))
    chosen, motion = make("imm", c), sensor(vx=30.0)
    state = chosen.start(one, motion)
    estimate = chosen.estimate(state, np.zeros(1, np.int64), motion)
    assert estimate[:3, 0] == pytest.approx([40.0, -10.0, 0.1])
    assert estimate[3:5, 0] == pytest.approx([1.5 + 40.0 * math.cos(0.1), 40.0 * math.sin(0.1)])
    for P in state.P[0]:
        np.testing.assert_array_equal(P[np.ix_([0, 1, 3], [0, 1, 3])], c.noise.covariance)
        assert P[4, 4] == pytest.approx((c.start.lateral_speed_mps / math.cos(0.1) / 40.0) ** 2)
        assert P[5, 5] == pytest.approx((c.start.acceleration_mps2 / 40.0) ** 2)
    assert state.mu[0].tolist() == [0.5, 0.5]


def test_estimates_over_ground_are_those_of_the_polar_state():
    chosen, motion = make("imm", FilterSettings(mount_forward_m=1.5)), sensor(vx=30.0, vy=0.5)
    r, rate, push, azimuth, turning, twist = x = np.array([50.0, -4.0, 1.0, 0.4, 0.02, 0.01])
    state = imm.init(x[None], np.eye(6)[None], np.array([0.7, 0.3]))
    found = Estimate(*chosen.estimate(state, np.zeros(1, np.int64), motion))
    along, across = (
        np.array([np.cos(azimuth), np.sin(azimuth)]),
        np.array([-np.sin(azimuth), np.cos(azimuth)]),
    )
    assert [found.x_m[0] - 1.5, found.y_m[0]] == pytest.approx(r * along)
    assert [found.vx_mps[0] - 30.0, found.vy_mps[0] - 0.5] == pytest.approx(
        rate * along + r * turning * across
    )
    assert [found.ax_mps2[0], found.ay_mps2[0]] == pytest.approx(push * along + r * twist * across)
    assert found.probability_cv[0] == pytest.approx(0.7)


def test_a_restart_forgets_the_covariance_of_the_lost_alone():
    c = FilterSettings()
    x = np.array([[50.0, -4.0, 1.0, 0.4, 0.02, 0.01]] * 2)
    before = imm.init(x, 9.0 * np.eye(6)[None].repeat(2, axis=0), np.array([0.7, 0.3]))
    after = make("imm", c).restart(before, np.array([False, True]))
    for kept, part in zip(before, after, strict=True):
        np.testing.assert_array_equal(part[0], kept[0])
    np.testing.assert_array_equal(after.x, before.x)
    assert after.mu[1].tolist() == [0.5, 0.5]
    speed, pull = c.start.lateral_speed_mps / 50.0, c.start.acceleration_mps2
    noise = np.diag(c.noise.covariance)
    expected = [noise[0], noise[1], pull**2, noise[2], speed**2, (pull / 50.0) ** 2]
    for P in after.P[1]:
        np.testing.assert_allclose(P, np.diag(expected))
