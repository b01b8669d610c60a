"""The lane-departure warning on constructed and on predicted crossings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_prediction import motion

from plugin.motion.prediction import PredictionSettings, constant_velocity, predictor
from plugin.warning import departure
from plugin.warning.departure import (
    CODES,
    INACTIVE,
    LANE_NOT_SEEN,
    READY,
    SUPPRESSED,
    WARNING_LEFT,
    WARNING_RIGHT,
    DepartureSettings,
)
from plugin.warning.tlc import Crossing, time_to_lane_crossing
from sumo_net.batch import join, select
from sumo_net.settings import SettingsError, read
from sumo_net.vehicle import Vehicle

HALF = Vehicle()
PREDICTOR = predictor(HALF, PredictionSettings())
INSIDE_M = 1.125  # the car's centre may be so far off before a wheel is on the border


def play(
    offset, drift, v=25.0, signal=0, shift=0, settings=None, state=None, known=True, settled=np.inf,
    unseen=(0.0, 0.0),
):  # fmt: skip
    """Run k steps over offsets and drifts (k,) or (k, n); returns the warnings as columns (k, n)."""
    offset = np.asarray(offset, float)
    offset = offset[:, None] if offset.ndim == 1 else offset

    def column(value, kind=float):
        value = np.asarray(value, kind)
        return np.broadcast_to(value[:, None] if value.ndim == 1 else value, offset.shape)

    drift, v, known = column(drift), column(v), column(known, bool)
    signal, shift, settled = column(signal, np.int8), column(shift, np.int8), column(settled)
    unseen = [column(side) for side in unseen]
    numbers = departure.numbers(settings or DepartureSettings())
    state, out = state or departure.init(offset.shape[1]), []
    for k in range(len(offset)):
        m = motion(lateral_speed=drift[k], offset=np.where(known[k], offset[k], np.nan))
        m = m._replace(lane_shift=shift[k].copy(), settled_s=settled[k].copy())
        path = constant_velocity(m, v[k].copy(), PREDICTOR)
        crossing = time_to_lane_crossing(m, path, PREDICTOR.step_s, HALF)
        unseen_m = unseen[0][k].copy(), unseen[1][k].copy()
        state, warning = departure.step(state, crossing, m, unseen_m, v[k].copy(), signal[k].copy(), numbers)
        out.append(warning)
    return departure.DepartureWarning(*(np.array(part) for part in zip(*out, strict=True)))


def drift_out(speed=0.4, steps=50, start=0.0):
    drift = np.full(steps, speed)
    return start + 0.1 * np.cumsum(drift), drift


def test_warns_once_a_second_before_the_crossing():
    offset, drift = drift_out()
    got = play(offset, drift)
    begun = np.flatnonzero(got.started[:, 0])
    assert len(begun) == 1
    lead = (INSIDE_M - offset[begun[0]]) / 0.4
    assert lead == pytest.approx(1.0, abs=0.11)
    assert lead <= 1.0 + 1e-9
    assert got.code[begun[0], 0] == WARNING_LEFT
    assert got.side[begun[0], 0] == 1
    assert (got.code[: begun[0], 0] == READY).all()


def test_a_border_that_is_only_drawn_on_from_far_ahead_does_not_warn():
    """In a junction the lines beyond it are followed; where they would be beside the car, none is painted."""
    offset, drift = drift_out()
    limit = DepartureSettings().unseen_m
    assert not play(offset, drift, unseen=(limit + 0.1, limit + 0.1)).started.any()
    assert not play(offset, drift, unseen=(np.inf, 0.0)).started.any()
    assert play(offset, drift, unseen=(limit, np.inf)).started.sum() == 1
    assert play(-offset, -drift, unseen=(np.inf, limit)).started.sum() == -1
    again = np.where(np.arange(len(offset)) < 25, 30.0, 0.0)  # paint comes near, late as it is
    begun = np.flatnonzero(play(offset, drift, unseen=(again, 50.0)).started[:, 0])
    assert begun.tolist() == [25]


def test_a_border_whose_paint_is_worn_off_warns_while_the_other_one_is_seen():
    """Seed 768 of the evaluation: dashes worn off for 47 m, the right line seen, and both far ahead."""
    offset, drift = drift_out()
    whole = play(offset, drift).started
    np.testing.assert_array_equal(play(offset, drift, unseen=(47.0, 13.0)).started, whole)
    np.testing.assert_array_equal(play(-offset, -drift, unseen=(13.0, 47.0)).started, -whole)


def test_a_single_look_that_jumps_does_not_warn():
    offset = np.full(30, 0.2)
    drift = np.zeros(30)
    drift[15], offset[15] = 1.2, 0.4
    assert not play(offset, drift).started.any()
    drift[15:17], offset[15:17] = 1.2, 0.4
    assert play(offset, drift).started.any()


def test_confirmation_costs_no_lead_in_a_true_approach():
    offset, drift = drift_out(0.7)
    with_confirmation = play(offset, drift).started[:, 0]
    without = play(offset, drift, settings=DepartureSettings(confirm_s=1e6)).started[:, 0]
    np.testing.assert_array_equal(with_confirmation, without)


def test_the_warning_lasts_at_least_and_at_most_what_is_set():
    offset = np.r_[drift_out(0.5, 13)[0], np.full(60, 0.0)]
    drift = np.r_[np.full(13, 0.5), np.full(60, -0.3)]
    active = play(offset, drift).side[:, 0] != 0
    assert active.sum() == pytest.approx(5, abs=1)
    offset, drift = drift_out(0.5, 22)
    offset, drift = np.r_[offset, np.full(80, 1.2)], np.r_[drift, np.full(80, 0.0)]
    active = play(offset, drift).side[:, 0] != 0
    assert active.sum() == pytest.approx(40, abs=1)


def test_one_warning_an_approach_and_armed_again_after_return():
    wobble = 0.95 + 0.07 * np.sin(np.arange(100) * 0.5)  # TLC swings about the threshold near the border
    drift = np.r_[0.0, np.diff(wobble)] / 0.1
    assert np.count_nonzero(play(wobble, drift, settings=DepartureSettings(rearm_s=1e3)).started) == 1
    begun = np.flatnonzero(play(wobble, drift).started)
    assert len(begun) > 1
    assert np.all(np.diff(begun) >= 30)
    there = np.r_[np.linspace(0, 1.05, 22), np.linspace(1.05, 0, 22)[1:]]
    twice = np.r_[there, np.zeros(10), there]
    got = play(twice, np.r_[0.0, np.diff(twice)] / 0.1)
    assert np.count_nonzero(got.started) == 2


@pytest.mark.parametrize("side", [1, -1])
def test_a_side_is_not_armed_again_while_its_crossing_is_near(side):
    # 0.33 m inside, further than rearm_gap_m, but about to cross: after the longest warning none follows
    got = play(np.full(90, side * 0.8), np.full(90, side * 0.35))
    assert (got.started[:, 0] != 0).sum() == 1
    assert (got.side[:, 0] != 0).sum() == 40


def test_a_warning_lasts_until_the_wheel_is_back_and_ends_beyond_the_latest_line():
    out, back = drift_out(0.5, 24)[0], np.linspace(1.2, 0.6, 25)
    offset = np.r_[out, back]
    drift = np.r_[np.full(24, 0.5), np.full(25, -0.25)]
    active, over = play(offset, drift).side[:, 0] != 0, offset >= INSIDE_M
    assert active[over].all()
    assert not active[np.flatnonzero(over)[-1] + 1 :].any()
    offset = np.r_[drift_out(0.5, 31)[0], np.full(20, 1.55)]
    active = play(offset, np.r_[np.full(31, 0.5), np.full(20, 0.1)]).side[:, 0] != 0
    assert not active[offset > INSIDE_M + 0.3].any()
    assert active[(offset > INSIDE_M) & (offset < INSIDE_M + 0.3)].all()


def test_inactive_below_its_speed_with_hysteresis():
    offset, drift = drift_out(0.4)
    assert (play(offset, drift, v=10.0).code == INACTIVE).all()
    speed = np.r_[
        np.full(10, 12.0), np.full(10, 10.5), np.full(10, 9.0), np.full(10, 10.5), np.full(10, 12.0)
    ]
    got = play(np.zeros(50), np.zeros(50), v=speed).code[:, 0]
    assert (got[:20] == READY).all()
    assert (got[20:40] == INACTIVE).all()
    assert (got[40:] == READY).all()


def test_lane_not_seen_is_a_state_and_ends_no_running_warning_early():
    offset, drift = drift_out(0.5, 60)
    known = np.ones(60, bool)
    known[30:40] = False
    got = play(np.minimum(offset, 0.2), np.zeros(60), known=known).code[:, 0]
    assert (got[30:40] == LANE_NOT_SEEN).all()
    first = int(np.argmax(play(offset, drift).started[:, 0] != 0))
    known = np.ones(60, bool)
    known[first + 1 :] = False
    got = play(offset, drift, known=known)
    assert (got.side[first : first + 5, 0] == 1).all()
    assert (got.code[first + 10 :, 0] == LANE_NOT_SEEN).all()


def test_turn_signal_excuses_its_side_and_some_time_after():
    offset, drift = drift_out(0.4)
    got = play(offset, drift, signal=1)
    assert not got.started.any()
    assert (got.code == SUPPRESSED).any()
    assert play(offset, drift, signal=-1).started.any()
    first = int(np.argmax(play(offset, drift).started[:, 0] != 0))
    signal = np.zeros(50)
    signal[: first - 5] = 1
    delayed = play(offset, drift, signal=signal).started[:, 0]
    assert np.argmax(delayed != 0) == first - 6 + 15  # 1.5 s after the last signalled step


def test_level_two_at_the_border():
    offset, drift = drift_out(0.4)
    got = play(offset, drift)
    over = offset >= INSIDE_M
    active = got.side[:, 0] != 0
    assert (got.level[active & over, 0] == 2).all()
    left_s = (INSIDE_M - offset) / 0.4
    assert (got.level[active & (left_s < 0.299), 0] == 2).all()
    assert (got.level[active & (left_s > 0.301), 0] == 1).all()
    assert (got.level[~active, 0] == 0).all()


def test_slow_drift_is_warned_at_the_border_and_none_without_drift():
    offset = np.linspace(0.9, 1.2, 100)  # 3 cm/s: its TLC of 1 s is 3 cm, less than a camera's error
    settings = DepartureSettings(least_drift_mps=0.02)
    first = int(np.argmax(play(offset, np.full(100, 0.03), settings=settings).started[:, 0]))
    assert INSIDE_M - offset[first] == pytest.approx(0.10, abs=0.01)
    assert not play(np.full(50, 1.06), np.zeros(50)).started.any()


def test_not_earlier_and_not_later_than_the_zone():
    # 1.2 m/s from the far side: TLC 1 s is 1.2 m inside, the zone begins at 1.5 m
    offset, drift = drift_out(1.2, 18, -0.9)
    first = int(np.argmax(play(offset, drift).started[:, 0] != 0))
    assert INSIDE_M - offset[first] == pytest.approx(1.2, abs=0.13)
    early = DepartureSettings(threshold_s=3.0, hysteresis_s=0.0)
    offset, drift = drift_out(0.4, 45, -0.5)
    first = int(np.argmax(play(offset, drift, settings=early).started[:, 0] != 0))
    assert 0.71 <= INSIDE_M - offset[first] <= 0.75 + 1e-9  # the next step after the line
    offset, drift = drift_out(0.8, 35, -1.1)
    first = int(np.argmax(play(offset, drift, settings=early).started[:, 0] != 0))
    assert 1.12 <= INSIDE_M - offset[first] <= 1.2 + 1e-9  # 1.5 s times the rate of departure
    offset, drift = drift_out(2.0, 12, -1.1)
    first = int(np.argmax(play(offset, drift, settings=early).started[:, 0] != 0))
    assert 1.3 <= INSIDE_M - offset[first] <= 1.5 + 1e-9
    # found beyond the border by more than 0.3 m: too late to warn
    assert not play(np.full(20, INSIDE_M + 0.35), np.full(20, 0.2)).started.any()
    assert play(np.full(20, INSIDE_M + 0.2), np.full(20, 0.2)).started.any()


def test_after_a_change_of_lane_the_border_behind_does_not_warn():
    # the centre of gravity crosses at 0.8 m/s; the right wheel is then over the border just crossed
    offset = np.r_[np.arange(1.0, 1.875, 0.08), np.arange(-1.875, 0.0, 0.08)]
    shift = np.zeros(len(offset))
    shift[np.argmin(offset)] = 1
    noisy = np.full(len(offset), 0.8)
    noisy[np.argmin(offset) + 2 :] = -0.05  # one estimate of a drift back to the border
    got = play(offset, noisy, shift=shift)
    assert (got.started[int(np.argmin(offset)) :, 0] == 0).all()
    assert np.count_nonzero(got.started) == 1


@pytest.mark.parametrize("clear_m", [0.15, 0.07])
def test_coming_back_over_the_border_just_crossed_warns(clear_m):
    # into the lane on the left until the right wheel is so far clear of the border, and back at once
    inside = 1.875 + (1.875 - INSIDE_M) + clear_m
    across = np.arange(1.0, inside, 0.06)
    offset = np.r_[across, across[::-1]]
    drift = np.r_[np.full(len(across), 0.6), np.full(len(across), -0.6)]
    shift = np.r_[0, np.diff((offset > 1.875).astype(int))]
    offset = np.where(offset > 1.875, offset - 3.75, offset)
    begun = play(offset, drift, shift=shift).started[:, 0]
    assert begun[begun != 0].tolist() == [1, -1]
    assert len(across) <= np.argmax(begun == -1) < len(across) + 5


def test_after_a_change_of_lane_the_border_crossed_is_a_border_like_any_other():
    across = np.arange(1.0, 1.875, 0.08)
    wobble = -0.95 - 0.07 * np.sin(np.arange(100) * 0.5)  # TLC swings about the threshold near it
    offset = np.r_[across, np.linspace(-1.87, 0.0, 25), np.linspace(0.0, -0.95, 25), wobble]
    shift = np.zeros(len(offset))
    shift[len(across)] = 1
    drift = np.r_[0.8, np.diff(offset) / 0.1]
    drift[len(across)] = 0.8
    begun = play(offset, drift, shift=shift, settings=DepartureSettings(rearm_s=1e3)).started[:, 0]
    assert begun[begun != 0].tolist() == [1, -1]


def test_slowing_down_ends_a_warning_at_once():
    offset, drift = drift_out(0.5)
    first = int(np.argmax(play(offset, drift).started[:, 0] != 0))
    speed = np.where(np.arange(len(offset)) < first + 2, 25.0, 5.0)
    active = play(offset, drift, v=speed).side[:, 0] != 0
    assert np.flatnonzero(active).tolist() == [first, first + 1]


def test_no_warning_on_an_estimate_that_the_looks_contradict():
    offset, drift = drift_out()
    plain = int(np.argmax(play(offset, drift).started[:, 0] != 0))
    doubted = np.full(len(offset), 5.0)
    doubted[plain - 1 :] = 0.1 * np.arange(len(offset) - plain + 1)
    begun = int(np.argmax(play(offset, drift, settled=doubted).started[:, 0] != 0))
    assert begun == plain - 1 + 2  # consistent_s after the contradiction
    assert not play(offset, drift, settled=0.1).started.any()


def test_a_contradiction_half_a_second_before_the_crossing_leaves_time_to_warn():
    # one look contradicts an estimate that had not foreseen the crossing (seed 624 of the evaluation)
    offset, drift = drift_out(0.5)
    crossing = int(np.argmax(offset > INSIDE_M))
    foreseen = np.where(np.arange(len(offset)) < crossing - 4, 0.0, drift)
    settled = np.full(len(offset), 5.0)
    settled[crossing - 4 :] = 0.1 * np.arange(len(offset) - crossing + 4)
    begun = int(np.argmax(play(offset, foreseen, settled=settled).started[:, 0] != 0))
    assert 0 < begun < crossing


@given(
    start=st.floats(-0.5, 0.5),
    steps=st.lists(st.floats(-0.8, 0.8), min_size=20, max_size=40),
    signal=st.integers(-1, 1),
)
def test_mirror(start, steps, signal):
    drift = np.array(steps)
    offset = start + 0.1 * np.cumsum(drift)
    one = play(offset, drift, signal=signal)
    other = play(-offset, -drift, signal=-signal)
    swap = np.array([INACTIVE, READY, WARNING_RIGHT, WARNING_LEFT, SUPPRESSED, LANE_NOT_SEEN])
    np.testing.assert_array_equal(one.code, swap[other.code])
    np.testing.assert_array_equal(one.started, -other.started)
    np.testing.assert_array_equal(one.level, other.level)


def test_order_and_slices_change_nothing():
    rng = np.random.default_rng(4)
    drift = rng.normal(0, 0.4, (60, 6))
    offset = 0.1 * np.cumsum(drift, axis=0)
    whole, order = play(offset, drift), np.array([3, 0, 5, 1, 4, 2])
    mixed, part = play(offset[:, order], drift[:, order]), play(offset[:, 2:5], drift[:, 2:5])
    for a, b, c in zip(whole, mixed, part, strict=True):
        np.testing.assert_array_equal(a[:, order], b)
        np.testing.assert_array_equal(a[:, 2:5], c)


def test_state_can_be_split_and_joined():
    state = departure.init(3)
    for part, whole in zip(join(select(state, slice(0, 1)), select(state, slice(1, 3))), state, strict=True):
        np.testing.assert_array_equal(part, whole)


def test_every_code_has_a_name():
    assert CODES[WARNING_LEFT] == "warning left"
    assert len(CODES) == LANE_NOT_SEEN + 1


def test_settings_say_what_is_wrong():
    with pytest.raises(SettingsError, match=r"least_duration_s = 9.0: must not be above most_duration_s"):
        read(DepartureSettings, {"least_duration_s": 9.0}, "x.toml")
    with pytest.raises(SettingsError, match="did you mean 'threshold_s'"):
        read(DepartureSettings, {"treshold_s": 1.0}, "x.toml")


def test_nan_speed_is_inactive():
    m = motion(offset=0.0)
    never = Crossing(*(np.array([value]) for value in (np.inf, 0, np.inf, np.inf, 1.0, 1.0)))
    _, got = departure.step(
        departure.init(1),
        never,
        m,
        (np.zeros(1), np.zeros(1)),
        np.array([np.nan]),
        np.zeros(1, np.int8),
        departure.numbers(DepartureSettings()),
    )
    assert got.code[0] == INACTIVE
