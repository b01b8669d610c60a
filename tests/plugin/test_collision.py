"""Start and end of the rear-end warning, and its outputs."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from plugin.motion.estimate import MotionEstimate
from plugin.tracking.classification_kernels import ONCOMING, SAME_DIRECTION, STATIONARY
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
    Targets,
    on_vehicle,
    targets_from,
)
from plugin.warning.safe_distance import MODELS, SURFACES, SafeDistance
from sumo_net.batch import select
from sumo_net.vehicle import Vehicle
from tests.plugin.cars_ahead import Driver, V, motion, targets


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
        rng.random(size) < 0.9, rng.random(size) < 0.1, rng.random(size) < 0.5,
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
    first = np.flatnonzero(mine)[0]  # among all tracks
    row, nearest = (np.where(one >= 0, one + first, -1) for one in (warning.row, warning.nearest))
    expected = (*state_part, *warning._replace(row=row, nearest=nearest))
    for x, y in zip((*select(state, cut), *select(whole, cut)), expected, strict=True):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(path.inside[mine], path_part.inside)
    order = np.random.default_rng(0).permutation(len(found.owner))
    _, mixed, _ = play(select(found, order), lane, v, a, yaw_rate)
    np.testing.assert_array_equal(whole.level, mixed.level)
    np.testing.assert_array_equal(whole.track_id, mixed.track_id)


def test_targets_are_confirmed_tracks_detected_lately_that_do_not_come_towards_us() -> None:
    states = (SAME_DIRECTION, ONCOMING, STATIONARY)
    state = np.array([*states, *states[:1] * 2], np.int8)
    count = np.arange(5)
    estimate = Estimate(*(count * 10.0 + k for k in range(len(Estimate._fields))))
    listed = TrackList(
        count, count + 3, count - 9, count != 3, np.array([0, 1, 2, 3, -1]), state, 0 * count, estimate
    )
    found = targets_from(listed, np.array([0.0, 0.0, 0.0, 0.0, 0.4]), np.array([-1, 4, 4, 4, 7]))
    assert found.usable.tolist() == [True, False, True, False, False]
    assert found.standing.tolist() == [False, False, True, False, False]
    assert found.detected.tolist() == [True, True, True, True, False]
    assert found.sighted.tolist() == [False, True, False, False, True]
    assert found.x_m.tolist() == [3.0, 13.0, 23.0, 33.0, 43.0]
    assert targets_from(listed, np.full(5, 0.2), np.full(5, -1)).usable[4]


def test_nobody_ahead_and_no_vehicles() -> None:
    none = select(targets({"gap": 10.0}), slice(0, 0))
    _, warning, _ = play(none, motion(3), np.full(3, V), np.zeros(3), np.zeros(3))
    assert warning.code.tolist() == [READY] * 3
    _, warning, _ = play(none, motion(0), np.zeros(0), np.zeros(0), np.zeros(0))
    assert len(warning.level) == 0


def test_the_gap_begins_at_the_vehicles_bumper_where_none_is_set() -> None:
    lorry = Vehicle(front_axle_m=3.4, front_overhang_m=1.4)
    gaps = {}
    for bumper_m in (None, 2.0):
        driver = Driver()
        driver.options = on_vehicle(Collision(bumper_m=bumper_m), lorry)
        gaps[bumper_m] = driver.warn({"gap": 40.0}).gap_m[
            0
        ]  # of the default vehicle, whose bumper is at 1.6 m
    assert gaps == pytest.approx({None: 40.0 - 3.2, 2.0: 40.0 - 0.4})


def test_settings_say_what_is_wrong() -> None:
    with pytest.raises(ValidationError, match="enter_m = 1\\.7: must be below half_lane_m = 1\\.6"):
        Collision(enter_m=1.7)
