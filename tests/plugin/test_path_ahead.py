"""Which of the tracks ahead are in the path of the vehicle."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plugin.warning.collision import READY, Collision
from plugin.warning.collision_kernels import road_offset
from tests.plugin.cars_ahead import LOST, Driver, V
from tests.roads import road_ahead


@given(st.floats(-0.004, 0.004), st.floats(-1.5e-5, 1.5e-5), st.floats(-1.5, 1.5), st.floats(-0.06, 0.06))
@settings(max_examples=60)
def test_offset_from_a_bending_lane(curvature: float, rate: float, d: float, heading: float) -> None:
    """A point of the lane's middle has no offset, one beside it that of its distance."""
    road = road_ahead(curvature, rate, d, heading)
    for j in np.flatnonzero((road.station_m[0] > 1005.0) & (road.station_m[0] < 1080.0))[::5]:
        x, y, direction = road.forward_m[0, j], road.left_m[0, j], road.heading_rad[0, j]
        assert road_offset(x, y, d, heading, curvature, rate, 200.0) == pytest.approx(0.0, abs=0.06)
        x, y = x - 2.0 * math.sin(direction), y + 2.0 * math.cos(direction)
        assert road_offset(x, y, d, heading, curvature, rate, 200.0) == pytest.approx(2.0, abs=0.08)


def test_offset_from_a_circle_is_exact() -> None:
    for curvature in (0.004, -0.002):
        angle = 0.3 * np.sign(curvature)
        radius = 1.0 / curvature
        x, y = (radius - 1.5) * math.sin(angle), radius - (radius - 1.5) * math.cos(angle)
        assert road_offset(x, y, 0.0, 0.0, curvature, 0.0, 60.0) == pytest.approx(1.5, abs=1e-9)


def test_path_bends_with_the_lane() -> None:
    """R 500 m to the left: 60 m ahead the lane lies 3.6 m to the left."""
    driver = Driver()
    own, straight_on = {"x_m": 60.0, "y_m": 3.6}, {"x_m": 60.0, "y_m": 0.0}
    _, path = driver.step(own, straight_on, curvature_1pm=0.002)
    assert path.inside.tolist() == [True, False]
    assert path.offset_m == pytest.approx([0.0, -3.6], abs=0.05)
    _, path = Driver().step(own, straight_on)
    assert path.inside.tolist() == [False, True]


def test_path_follows_the_vehicles_own_place_in_the_lane() -> None:
    ahead = {"x_m": 40.0, "y_m": -0.8}  # in the lane's middle, the vehicle is 0.8 m left of it
    _, path = Driver().step(ahead, lateral_offset_m=0.8)
    assert path.offset_m == pytest.approx([0.0])
    _, path = Driver().step(ahead, heading_error_rad=0.05)
    assert path.offset_m == pytest.approx([40.0 * math.sin(0.05) - 0.8], abs=0.01)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_lane_that_is_entered_belongs_to_the_path(side: float) -> None:
    """Who will be over the border within 1 s has the leader there, and whoever is between the lanes."""
    lane = {"lateral_offset_m": side * 1.0, "heading_error_rad": side * 0.02}  # 0.6 m/s towards the border
    there, between = {"x_m": 30.0, "y_m": side * 2.0}, {"x_m": 30.0, "y_m": side * 0.2}
    post = {**there, "vx_mps": 0.0, "standing": 1}
    _, path = Driver().step(there, between, post, **lane)
    assert np.abs(path.offset_m) == pytest.approx([3.6, 1.8, 3.6], abs=0.01)
    assert not path.inside.any()
    _, path = Driver().step(there, between, post, **lane, lateral_speed_mps=side * 0.4)
    assert path.inside.tolist() == [True, True, False]
    _, path = Driver(entering_s=0.0).step(there, between, post, **lane, lateral_speed_mps=side * 0.4)
    assert not path.inside.any()


def test_path_is_the_steered_circle_while_the_lane_is_lost() -> None:
    on_circle = {"x_m": 40.0, "y_m": 1.6}  # R 500 m
    _, path = Driver().step(on_circle, {"x_m": 40.0, "y_m": -1.6}, yaw_rate=0.06, **LOST)
    assert path.inside.tolist() == [True, False]
    _, path = Driver().step(on_circle, {"x_m": 40.0, "y_m": -1.6}, yaw_rate=-0.06, **LOST)
    assert path.inside.tolist() == [False, True]
    _, path = Driver().step({"x_m": 100.0, "y_m": 0.0}, **LOST)
    assert not path.inside[0]  # beyond the reach of the steered circle


def test_a_lane_that_bends_quite_unlike_the_steering_counts_as_lost() -> None:
    """A guard rail post beside a straight road got into the path of a lane seen with R 110 m."""
    post = {"x_m": 55.0, "y_m": 8.0, "vx_mps": 0.0, "standing": 1}
    _, path = Driver().step(post, curvature_1pm=0.009, curvature_rate_1pm2=-1e-4)
    assert abs(path.offset_m[0]) > 7.0
    assert not path.inside[0]
    _, path = Driver().step(post, curvature_1pm=0.003, yaw_rate=0.003 * V)
    assert abs(path.offset_m[0]) < 4.0  # the lane is trusted if the steering agrees


def test_a_lane_whose_bend_changes_as_no_road_s_does_counts_as_lost() -> None:
    """Posts beside a road in shadow got into the path of a lane seen with K' v³ of 1.3 to 5.7 m/s³."""
    limit = Collision().jerk_mps3 / V**3
    for rate in (0.98 * limit, -0.98 * limit):
        swing = rate * 60.0**3 / 6.0
        post = {"x_m": 60.0, "y_m": swing, "vx_mps": 0.0, "standing": 1}
        _, path = Driver(stationary_steps=1).step(post, curvature_rate_1pm2=rate)
        assert path.offset_m[0] == pytest.approx(0.0, abs=0.05)
        assert path.inside[0]
        beyond = 1.02 / 0.98 * rate
        _, path = Driver(stationary_steps=1).step(post, curvature_rate_1pm2=beyond)
        assert path.offset_m[0] == pytest.approx(swing)  # straight on, as it is steered
        assert not path.inside[0]
        slower = {"x_m": 60.0, "y_m": 1.02 / 0.98 * swing, "vx_mps": 0.0, "standing": 1}
        _, path = Driver(stationary_steps=1).step(slower, v=0.9 * V, curvature_rate_1pm2=beyond)
        assert path.inside[0]  # bends may be as tight where one drives as slowly


def test_a_guard_rail_seen_in_shadow_is_no_danger() -> None:
    """Seed 506 of the default highway in complex light, from 24.9 s: danger was warned of its post."""
    driver, v = Driver(), 32.0
    for x, y, heading, curvature, jerk in (
        (87.3, 5.1, -0.001, -0.00174, 3.58),
        (84.1, 5.3, -0.004, -0.00246, 4.86),
        (80.8, 5.4, -0.002, -0.00177, 4.58),
        (77.6, 5.5, -0.004, -0.00223, 5.32),
        (74.3, 5.6, -0.001, -0.00171, 4.84),
    ):
        lane = {"lateral_offset_m": -0.15, "heading_error_rad": heading, "curvature_1pm": curvature}
        post = {"x_m": x, "y_m": y, "vx_mps": 0.0, "standing": 1}
        warning, _ = driver.step(post, v=v, yaw_rate=-0.0009 * v, curvature_rate_1pm2=jerk / v**3, **lane)
        assert warning.code[0] == READY


def test_hysteresis_keeps_a_target_at_the_border() -> None:
    driver = Driver()
    inside = [driver.step({"x_m": 40.0, "y_m": y})[1].inside[0] for y in (1.8, 1.4, 1.8, 1.84, 2.2, 1.8)]
    assert inside == [False, True, True, True, False, False]


def test_path_narrows_with_the_distance_for_a_curvature_that_may_be_wrong() -> None:
    assert Driver().step({"x_m": 40.0, "y_m": 1.4})[1].inside[0]
    assert not Driver().step({"x_m": 100.0, "y_m": 1.4})[1].inside[0]
    assert Driver(curvature_doubt_1pm=0.0).step({"x_m": 100.0, "y_m": 1.4})[1].inside[0]


def test_nearest_in_path_is_the_target_and_no_one_else_counts() -> None:
    far, near = {"gap": 80.0, "track_id": 7}, {"gap": 30.0, "track_id": 9}
    beside = {"gap": 10.0, "y_m": 3.75}
    unusable = {"gap": 12.0, "usable": 0}
    warning, _ = Driver().step(far, near, beside, unusable)
    assert warning.track_id[0] == 9
    assert warning.row[0] == 1
    assert warning.gap_m[0] == pytest.approx(30.0)
    warning, _ = Driver().step(beside)
    assert (warning.row[0], warning.track_id[0], warning.code[0]) == (-1, -1, READY)
    assert np.isnan([warning.gap_m[0], warning.ttc_s[0], warning.shown_distance_m[0]]).all()


def test_what_is_passed_beside_the_front_or_never_moved_far_away_is_not_in_path() -> None:
    assert not Driver().step({"gap": 3.0, "y_m": 1.6})[1].inside[0]
    assert not Driver().step({"gap": 1.0, "y_m": 0.2})[1].inside[0]  # nothing gets in so near
    driver = Driver()
    driver.step({"gap": 3.0})
    assert driver.step({"gap": 1.0})[1].inside[0]  # but what was in path stays
    post = {"gap": 80.0, "vx_mps": 0.0, "standing": 1}
    at_once = {"stationary_steps": 1}
    assert Driver(**at_once).step(post)[1].inside[0]
    assert not Driver(**at_once).step(post | {"y_m": 1.3})[1].inside[0]
    assert not Driver(**at_once).step(post | {"gap": 95.0})[1].inside[0]


def test_what_never_moved_counts_once_it_has_been_in_the_path_for_some_steps_or_is_near() -> None:
    """A path that swings for some steps meets posts beside the road: seed 697 of `highway`, complex light."""
    far, near = ({"gap": gap, "vx_mps": 0.0, "standing": 1} for gap in (80.0, 55.0))
    driver = Driver()
    assert [driver.step(far)[1].inside[0] for _ in range(6)] == [False] * 4 + [True] * 2
    assert not driver.step(far | {"y_m": 3.0})[1].inside[0]
    assert not driver.step(far)[1].inside[0]  # from the beginning
    assert Driver().step(near)[1].inside[0]
    # the steps count from where it comes into the path, not from where it is near enough to be warned of
    driver = Driver()
    assert [driver.step(far | {"gap": gap})[1].inside[0] for gap in (100.0, 97.0, 94.0, 91.0, 88.0)][-1]


SLOW = {"v": 15.0}
POST = {"gap": 35.0, "vx_mps": 0.0, "standing": 1, "track_id": 7}


def proved(share: float = 1.0, **options: float) -> Driver:
    """A vehicle that has followed another for 10 s, whose rear its camera saw in a share of the frames."""
    driver, seen = Driver(**options), 0.0
    for _ in range(100):
        seen += share
        driver.step({"gap": 30.0, "sighted": int(seen >= 1.0)}, **SLOW)
        seen %= 1.0
    return driver


def test_posts_behind_a_corner_are_no_vehicles_for_a_camera_that_sees_vehicles() -> None:
    """A path straight on meets them where a street ends, in a scenario of Bologna."""
    car = POST | {"sighted": 1}
    driver = proved()
    assert not any(driver.step(POST, **SLOW)[1].inside[0] for _ in range(20))
    looks = [driver.step(one, **SLOW)[1].inside[0] for one in (car, POST, car, POST)]
    assert looks == [False, False, True, True]
    assert not driver.step(POST | {"y_m": 3.0}, **SLOW)[1].inside[0]
    assert not driver.step(car, **SLOW)[1].inside[0]  # from the beginning
    assert driver.step(POST | {"gap": 14.0}, **SLOW)[1].inside[0]  # too near to wait


def test_what_never_moved_counts_for_a_camera_that_may_be_blind_and_beyond_its_reach() -> None:
    assert Driver().warn(POST, steps=5, **SLOW).row[0] == 0  # it has never seen a vehicle
    assert proved(0.2).warn(POST, steps=5, **SLOW).row[0] == 0  # it sees one now and then
    assert proved(0.8).warn(POST, steps=5, **SLOW).row[0] == -1
    driver = proved(sight_memory_s=5.0)
    assert driver.warn(POST, steps=30, **SLOW).row[0] == -1
    assert driver.warn(POST, steps=30, **SLOW).row[0] == 0  # forgotten: 35 % are left after 5.2 s
    driver = proved()  # at 30 m/s it counts from 90 m on, and does not cease to where the camera would see it
    assert [driver.step(POST | {"gap": 83.0 - 3.0 * k})[1].inside[0] for k in range(18)][4:] == [True] * 14


def test_camera_looks_at_the_nearest_body_in_path_before_it_counts() -> None:
    post, car = POST | {"gap": 40.0}, {"gap": 60.0}
    driver = proved()
    warning, _ = driver.step(post, car)
    assert (warning.nearest[0], warning.row[0]) == (0, 1)
    warning, _ = driver.step(post | {"y_m": 4.0}, car)
    assert (warning.nearest[0], warning.row[0]) == (1, 1)
    warning, _ = driver.step(post | {"y_m": 4.0})
    assert (warning.nearest[0], warning.row[0]) == (-1, -1)


def test_a_target_that_was_not_detected_for_a_while_is_still_the_target_however_near() -> None:
    """Nothing enters the path nearer than `entry_gap_m`; a leader missed by three scans was lost for good."""
    driver, near = Driver(), {"gap": 1.5, "vx_mps": V - 4.0}
    driver.step({"gap": 3.0, "vx_mps": V - 4.0})
    for _ in range(3):
        _, path = driver.step({**near, "usable": 0, "detected": 0})
        assert not path.inside[0]
    assert driver.step(near)[1].inside[0]
    assert not Driver().step(near)[1].inside[0]


def test_in_a_queue_without_markings_the_leader_is_the_target_down_to_standstill() -> None:
    """With less than 2.5 s at the own speed counted from the centre of gravity, it was lost below 1.4 m/s."""
    for v in (2.0, 1.0, 0.3):
        assert Driver().step({"gap": 2.5, "vx_mps": 0.1}, v=v, **LOST)[1].inside[0]
        assert not Driver().step({"gap": 12.0, "vx_mps": 0.1}, v=v, **LOST)[1].inside[0]
