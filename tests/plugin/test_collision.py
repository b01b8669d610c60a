"""In-path selection, start and end of the warning, and its outputs."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from plugin.motion.estimate import MotionEstimate
from plugin.tracking import classification
from plugin.tracking.detections import Estimate
from plugin.tracking.tracker import TrackList
from plugin.warning import collision
from plugin.warning.collision import (
    ALARM,
    CHIME,
    DANGER,
    INACTIVE,
    READY,
    REMINDER,
    SILENT,
    SUPPRESSED,
    Collision,
    CollisionWarning,
    Targets,
    targets_from,
)
from plugin.warning.collision_kernels import road_offset
from plugin.warning.safe_distance import MODELS, SURFACES, SafeDistance
from sumo_net.batch import select
from tests.roads import road_ahead

V = 30.0


def motion(n: int = 1, **fields: Any) -> MotionEstimate:
    values = dict.fromkeys(MotionEstimate._fields[:-1], 0.0) | {"lane_width_m": 3.75} | fields
    parts = [np.broadcast_to(np.asarray(value, float), n).copy() for value in values.values()]
    return MotionEstimate._make([*parts, np.zeros(n, np.int8)])


LOST = dict.fromkeys(("lateral_offset_m", "heading_error_rad", "curvature_1pm", "lane_width_m"), math.nan)


def targets(*rows: dict[str, float]) -> Targets:
    """Cars at the same speed by default; gap instead of x."""
    blank = {
        "owner": 0,
        "y_m": 0.0,
        "vx_mps": V,
        "vy_mps": 0.0,
        "ax_mps2": 0.0,
        "detected": 1,
        "usable": 1,
        "standing": 0,
    }
    full = [blank | {"track_id": k} | row for k, row in enumerate(rows)]
    for row in full:
        row["x_m"] = row.pop("gap") + 1.6 if "gap" in row else row["x_m"]
    kinds = {"owner": np.int64, "track_id": np.int64, "detected": bool, "usable": bool, "standing": bool}
    return Targets(
        *(np.array([row[name] for row in full], kinds.get(name, float)) for name in Targets._fields)
    )


class Driver:
    """One vehicle, step by step."""

    def __init__(self, **options: Any) -> None:
        self.options, self.state = Collision(**options), collision.init(1)

    def step(
        self, *rows: dict[str, float], v: float = V, a: float = 0.0, yaw_rate: float = 0.0, **lane: float
    ) -> tuple[CollisionWarning, collision.InPath]:
        given_ = (targets(*rows), motion(**lane), np.array([v]), np.array([a]), np.array([yaw_rate]))
        self.state, warning, path = collision.step(self.state, *given_, self.options)
        return warning, path

    def warn(self, *rows: dict[str, float], steps: int = 3, **more: float) -> CollisionWarning:
        for _ in range(steps):
            warning, _ = self.step(*rows, **more)
        return warning


@given(st.floats(-0.004, 0.004), st.floats(-1.5e-5, 1.5e-5), st.floats(-1.5, 1.5), st.floats(-0.06, 0.06))
@settings(max_examples=60, deadline=None)
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


def test_levels_lamps_buzzer_and_display() -> None:
    driver = Driver()
    quiet = driver.warn({"gap": 40.0})
    assert (quiet.code[0], quiet.buzzer[0], quiet.lamp_reminder[0]) == (READY, SILENT, False)
    assert (quiet.shown_distance_m[0], quiet.shown_relative_mps[0]) == (40.0, 0.0)
    slower = {"gap": 45.0, "vx_mps": 20.0}
    first = driver.warn(slower, steps=1)
    assert first.level[0] == 0  # one step alone does not warn
    second = driver.warn(slower, steps=1)
    assert second.danger_m[0] < 45.0 < second.reminder_m[0]
    assert (second.code[0], second.started[0], second.buzzer[0]) == (REMINDER, 1, CHIME)
    assert (second.lamp_reminder[0], second.lamp_danger[0]) == (True, False)
    assert second.shown_relative_mps[0] == -10.0
    assert second.ttc_s[0] == pytest.approx(4.5)
    third = driver.warn(slower, steps=1)
    assert (third.started[0], third.buzzer[0]) == (0, SILENT)
    near = driver.warn(slower | {"gap": 15.0}, steps=2)
    assert (near.code[0], near.level[0], near.buzzer[0]) == (DANGER, 2, ALARM)
    assert near.lamp_danger[0]


def test_a_track_that_coasts_begins_no_warning_but_keeps_one() -> None:
    slower = {"gap": 15.0, "vx_mps": 20.0}
    assert Driver().warn(slower | {"detected": 0}, steps=10).level[0] == 0
    driver = Driver()
    assert driver.warn(slower).level[0] == 2
    assert driver.warn(slower | {"detected": 0}, steps=10).level[0] == 2


def test_warning_lasts_its_least_time_and_ends_with_relief() -> None:
    driver = Driver()
    driver.warn({"gap": 15.0, "vx_mps": 20.0}, steps=2)
    levels = [int(driver.step({"gap": 90.0})[0].level[0]) for _ in range(14)]
    assert levels == sorted(levels, reverse=True)
    assert levels.count(2) == 5  # danger: 0.6 s in all
    assert 0 < len(levels) - levels.index(0) <= 5  # the reminder: 1.0 s in all


def test_driver_who_brakes_enough_gets_neither_danger_nor_sound() -> None:
    slower = {"gap": 20.0, "vx_mps": 20.0}
    assert Driver().warn(slower).level[0] == 2
    braking = Driver().warn(slower, a=-6.0)  # 10 m/s away within 8.3 m
    assert braking.level[0] <= 1
    assert (braking.code[0], braking.buzzer[0], braking.lamp_danger[0]) == (SUPPRESSED, SILENT, False)
    too_little = Driver().warn(slower | {"gap": 10.0}, a=-3.0)
    assert too_little.level[0] == 2
    driver = Driver()
    driver.warn(slower)
    assert driver.warn(slower, a=-6.0, steps=1).level[0] == 1  # at once, no least time


def test_slow_vehicles_are_not_warned() -> None:
    close = {"gap": 2.5, "vx_mps": 0.0}
    assert Driver().warn(close, v=2.0).code[0] == INACTIVE
    assert Driver().warn(close, v=5.0).level[0] == 2
    driver = Driver()
    driver.warn({"gap": 50.0}, v=5.0)
    assert driver.warn({"gap": 50.0}, v=2.0, steps=1).code[0] == READY  # until well below
    assert driver.warn({"gap": 50.0}, v=1.2, steps=1).code[0] == INACTIVE


def approach(options: Collision, brake: float = -4.0, gap: float = 25.0) -> float:
    """Seconds from when the leader begins to brake to the reminder, both at 30 m/s, the driver asleep."""
    state, v_l = collision.init(1), V
    for k in range(60):
        row = {"gap": gap, "vx_mps": v_l, "ax_mps2": brake if k else 0.0}
        given_ = (targets(row), motion(), np.array([V]), np.zeros(1), np.zeros(1))
        state, warning, _ = collision.step(state, *given_, options)
        if warning.level[0]:
            return 0.1 * k
        gap, v_l = gap - (V - v_l) * 0.1 - 0.5 * -brake * 0.01, v_l + brake * 0.1
    return math.inf


def test_braking_leader_is_warned_of_before_two_seconds() -> None:
    """TTC 2 s: 25 - 2 t² = 8 t, so t = 2.06 s after he begins."""
    late = approach(
        Collision(
            distance=SafeDistance(model="ttc", ttc_reminder_s=2.0),
            acceleration_slack_mps2=9.0,
            floor_ttc_s=0.0,
        )
    )
    assert late > 1.9  # closing speed only
    for model in MODELS:
        assert approach(Collision(distance=SafeDistance(model=model))) < 1.7
    assert approach(Collision()) <= 0.3


@pytest.mark.parametrize("model", MODELS)
def test_slower_surface_warns_no_later(model: str) -> None:
    times = [
        approach(Collision(distance=SafeDistance(model=model, surface=surface)), brake=-1.5, gap=45.0)
        for surface in SURFACES
    ]
    assert times == sorted(times, reverse=True)


def fleet(n: int, seed: int = 3) -> tuple[Targets, MotionEstimate, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    count = rng.integers(0, 6, n)
    owner = np.repeat(np.arange(n), count)
    size = len(owner)
    track = np.arange(size) - np.repeat(np.cumsum(count) - count, count)
    found = Targets(
        owner, track, rng.uniform(5, 90, size), rng.uniform(-4, 4, size), rng.uniform(0, 35, size),
        np.zeros(size), rng.uniform(-6, 2, size), rng.random(size) < 0.9,
        rng.random(size) < 0.9, rng.random(size) < 0.1,
    )  # fmt: skip
    lane = motion(
        n,
        lateral_offset_m=rng.uniform(-1, 1, n),
        heading_error_rad=rng.uniform(-0.03, 0.03, n),
        curvature_1pm=rng.uniform(-2e-3, 2e-3, n),
        curvature_rate_1pm2=rng.uniform(-1e-5, 1e-5, n),
    )
    lane.lateral_offset_m[::4] = math.nan
    return found, lane, rng.uniform(1, 40, n), rng.uniform(-5, 2, n), rng.uniform(-0.05, 0.05, n)


def play(found: Targets, lane: MotionEstimate, *own: np.ndarray, steps: int = 4) -> tuple:
    state = collision.init(len(own[0]))
    for _ in range(steps):
        state, warning, path = collision.step(state, found, lane, *own, Collision())
    return state, warning, path


def test_mirrored_scene_same_warning() -> None:
    found, lane, v, a, yaw_rate = fleet(60)
    names = ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2")
    mirrored = lane._replace(**{name: -getattr(lane, name) for name in names})
    _, one, path = play(found, lane, v, a, yaw_rate)
    _, two, other = play(found._replace(y_m=-found.y_m), mirrored, v, a, -yaw_rate)
    assert (one.level > 0).sum() > 5
    for x, y in zip(one, two, strict=True):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_allclose(path.offset_m, -other.offset_m)


def test_slices_and_order_of_tracks_change_nothing() -> None:
    found, lane, v, a, yaw_rate = fleet(60)
    state, whole, path = play(found, lane, v, a, yaw_rate)
    mine = (found.owner >= 20) & (found.owner < 45)
    part = select(found, mine)._replace(owner=found.owner[mine] - 20)
    cut = slice(20, 45)
    state_part, warning, path_part = play(part, select(lane, cut), v[cut], a[cut], yaw_rate[cut])
    rows = np.where(warning.row >= 0, warning.row + np.flatnonzero(mine)[0], -1)  # among all tracks
    expected = (*state_part, *warning._replace(row=rows))
    for x, y in zip((*select(state, cut), *select(whole, cut)), expected, strict=True):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(path.inside[mine], path_part.inside)
    order = np.random.default_rng(0).permutation(len(found.owner))
    _, mixed, _ = play(select(found, order), lane, v, a, yaw_rate)
    np.testing.assert_array_equal(whole.level, mixed.level)
    np.testing.assert_array_equal(whole.track_id, mixed.track_id)


def test_targets_are_confirmed_tracks_detected_lately_that_do_not_come_towards_us() -> None:
    states = (classification.SAME_DIRECTION, classification.ONCOMING, classification.STATIONARY)
    state = np.array([*states, *states[:1] * 2], np.int8)
    count = np.arange(5)
    estimate = Estimate(*(count * 10.0 + k for k in range(len(Estimate._fields))))
    listed = TrackList(
        count, count + 3, count - 9, count != 3, np.array([0, 1, 2, 3, -1]), state, 0 * count, estimate
    )
    found = targets_from(listed, np.array([0.0, 0.0, 0.0, 0.0, 0.4]))
    assert found.usable.tolist() == [True, False, True, False, False]
    assert found.standing.tolist() == [False, False, True, False, False]
    assert found.detected.tolist() == [True, True, True, True, False]
    assert found.x_m.tolist() == [3.0, 13.0, 23.0, 33.0, 43.0]
    assert targets_from(listed, np.full(5, 0.2)).usable[4]


def test_nobody_ahead_and_no_vehicles() -> None:
    none = select(targets({"gap": 10.0}), slice(0, 0))
    _, warning, _ = play(none, motion(3), np.full(3, V), np.zeros(3), np.zeros(3))
    assert warning.code.tolist() == [READY] * 3
    _, warning, _ = play(none, motion(0), np.zeros(0), np.zeros(0), np.zeros(0))
    assert len(warning.level) == 0


def test_settings_say_what_is_wrong() -> None:
    with pytest.raises(ValidationError, match="enter_m = 1\\.7: must be below half_lane_m = 1\\.6"):
        Collision(enter_m=1.7)
