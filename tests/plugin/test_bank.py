"""Z11's observer bank against the figures of the source, checked in the specification."""

import numpy as np
import pytest
from manoeuvre import column, drive, looks, observed, unseen

from analysis.published import simulation
from plugin.motion import bank
from plugin.motion.bank import BankSettings
from plugin.motion.bank_kernels import observe
from sumo_net.batch import join, select
from sumo_net.vehicle import Vehicle, preview_model, zero_order_hold

HALF = Vehicle()
PREVIEW_M = 33.5
PRINTED = {
    80: np.array([[0.0, 0.0], [0.0, 0.0], [0.534, 2.722], [-0.442, 1.478]]),
    90: np.array([[0.0, 0.0], [0.0, 0.0], [0.444, 3.245], [-0.467, 1.630]]),
}


@pytest.fixture(scope="module")
def schedule():
    return bank.schedule(HALF, PREVIEW_M, BankSettings())


def test_one_observer_each_10_kmh(schedule):
    assert schedule.spacing_mps == pytest.approx(10 / 3.6)
    A, B = preview_model(HALF, 80 / 3.6, PREVIEW_M)
    transition, entry = zero_order_hold(A, B, 0.1)
    assert schedule.transition[8] == pytest.approx(transition)
    assert schedule.input[8] == pytest.approx(entry)


@pytest.mark.parametrize("kmh", [10, 50, 80, 90, 150])
def test_gain_is_what_the_covariance_recursion_settles_at(schedule, kmh):
    # eqs. 16, 17 and 19 iterated; R_1 on y_L and e_L only
    F, H = schedule.transition[kmh // 10], np.eye(4)[2:]
    Q, R, P = np.diag([0, 0, 0.01, 0.01]), np.eye(2) * 0.01, np.eye(4)
    for _ in range(400):
        P = F @ P @ F.T + Q
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        P = (np.eye(4) - gain @ H) @ P
    assert schedule.gain[kmh // 10] == pytest.approx(gain, abs=1e-6)


@pytest.mark.parametrize("kmh", [80, 90])
def test_gains_of_lateral_speed_and_yaw_rate_are_zero_as_printed(schedule, kmh):
    gain = schedule.gain[kmh // 10]
    assert gain[:2] == pytest.approx(PRINTED[kmh][:2], abs=1e-9)
    # The printed lower half is no Kalman gain: with R_2 a multiple of the identity, K = P Hᵀ / R_2 is
    # symmetric, the print is not (3.245 against -0.467); as a filter gain it is hardly stable or not at all,
    # as the gain of a predictor nearly dead-beat.
    # Ours differ from the print by up to 3.2.
    lower = PRINTED[kmh][2:]
    transition = schedule.transition[kmh // 10][2:, 2:]
    assert gain[2, 1] == pytest.approx(gain[3, 0])
    assert abs(lower[0, 1] - lower[1, 0]) > 3.0
    assert np.abs(np.linalg.eigvals((np.eye(2) - lower) @ transition)).max() > 0.98
    assert np.abs(np.linalg.eigvals(transition - lower)).max() < 0.1
    assert np.abs(np.linalg.eigvals((np.eye(2) - gain[2:]) @ transition)).max() < 0.7


@pytest.mark.parametrize(("kmh", "lateral_speed", "yaw_rate"), [(80, -1.413, 0.4002), (90, -1.984, 0.4176)])
def test_checked_steady_states_of_two_observers(schedule, kmh, lateral_speed, yaw_rate):
    x, out = np.zeros(4), np.zeros(4)
    for _ in range(100):
        observe(x, kmh // 10, schedule, 0.05, 0.001, False, 0.0, 0.0, out)
        x = out.copy()
    assert x[:2] == pytest.approx([lateral_speed, yaw_rate], abs=6e-4)


def test_at_88_kmh_the_observers_weigh_02_and_08(schedule):
    truth = drive(HALF, lambda *_: 0.01, lambda t: 88 / 3.6, lambda s: 0.001, duration_s=2.0)
    state, rows = observed(schedule, truth, looks(truth))
    assert state.below[0] == 8
    blend = 0.2 * state.lower[0] + 0.8 * state.upper[0]
    assert [rows[-1].lateral_speed_mps[0], rows[-1].yaw_rate_rps[0]] == pytest.approx(blend[:2])


@pytest.mark.parametrize("run_", simulation.RUNS, ids=lambda run_: run_.title)
def test_published_runs(run_):
    truth, seen = simulation.truth_of(run_)
    _, rows = observed(bank.schedule(run_.vehicle, PREVIEW_M, BankSettings()), truth, seen)
    late = truth.time_s >= 2.0
    yaw = column(rows, "yaw_rate_rps")[late, 0] / truth.yaw_rate_rps[late]
    lateral = column(rows, "lateral_speed_mps")[late, 0] / truth.lateral_speed_mps[late]
    assert np.abs(yaw - 1).max() < 0.02
    assert np.abs(lateral - 1).max() < 0.10


def test_full_load_seen_by_the_half_load_bank_keeps_the_yaw_rate_only():
    # The steer comes from the image, so f cancels in the yaw rate; v_y depends only on the model's mass.
    # Z11 claims a static error under 10 % here; the corrected equations give 21 %.
    truth, seen = simulation.truth_of(simulation.RUNS[2])
    _, rows = observed(bank.schedule(HALF, PREVIEW_M, BankSettings()), truth, seen)
    assert rows[-1].yaw_rate_rps[0] == pytest.approx(truth.yaw_rate_rps[-1], rel=0.02)
    assert rows[-1].lateral_speed_mps[0] / truth.lateral_speed_mps[-1] == pytest.approx(0.79, abs=0.02)


def test_passing_a_multiple_of_10_kmh_makes_no_jump(schedule):
    truth = drive(HALF, lambda *_: 0.005, lambda t: 79 / 3.6 + 0.4 * t, lambda s: 0.0, duration_s=4.0)
    _, rows = observed(schedule, truth, looks(truth))
    steps = np.abs(np.diff(column(rows, "yaw_rate_rps")[20:, 0]))
    assert steps.max() < 2e-3


def test_coasts_a_second_then_knows_nothing_then_starts_again(schedule):
    truth = drive(HALF, lambda *_: 0.001, lambda t: 25.0, duration_s=5.0)
    seen = looks(truth)
    seen[20:35] = [unseen(look) for look in seen[20:35]]
    _, rows = observed(schedule, truth, seen)
    known = np.isfinite(column(rows, "yaw_rate_rps")[:, 0])
    assert known[:30].all()
    assert not known[30:35].any()
    assert known[35:].all()


def test_change_of_lane_leaves_the_motion_untouched(schedule):
    truth = drive(HALF, lambda *_: 0.0005, lambda t: 25.0, duration_s=3.0, start=(0, 0, 0, 1.6, 0.01))
    seen = looks(truth)
    _, plain = observed(schedule, truth, seen)
    moved = [
        look._replace(
            preview_offset_m=look.preview_offset_m + 3.75,
            lane_shift=np.array([1 if k == 15 else 0], np.int8),
        )
        if k >= 15
        else look
        for k, look in enumerate(seen)
    ]
    _, rows = observed(schedule, truth, moved)
    for name in ("lateral_speed_mps", "yaw_rate_rps"):
        assert column(rows, name) == pytest.approx(column(plain, name), abs=1e-9)
    offset = column(rows, "lateral_offset_m")[:, 0] - column(plain, "lateral_offset_m")[:, 0]
    assert offset[15:] == pytest.approx(-3.75, abs=1e-9)
    assert [row.lane_shift[0] for row in rows[14:17]] == [0, 1, 0]


@pytest.mark.parametrize("v", [0.0, 0.3, 2.0, 5.0])
def test_slow_and_standing(schedule, v):
    truth = drive(HALF, lambda *_: 0.0, lambda t: max(v, 0.5), duration_s=2.0)
    state = bank.init(1)
    for look in looks(truth):
        state, motion = bank.step(state, schedule, look, np.array([v]))
    assert abs(motion.yaw_rate_rps[0]) < 1e-6
    assert abs(motion.lateral_speed_mps[0]) < 1e-6


def test_order_and_slices_change_nothing(schedule):
    truth = drive(HALF, lambda t, *_: 0.004 * np.sin(t), lambda t: 24.0 + 0.3 * t, duration_s=2.0)
    seen = looks(truth, np.random.default_rng(3), 6, 0.02, 1e-3, 1e-4)
    _, whole = observed(schedule, truth, seen)
    order = np.array([4, 2, 0, 5, 1, 3])
    _, mixed = observed(schedule, truth, [select(look, order) for look in seen])
    halves = [
        observed(schedule, truth, [select(look, part) for look in seen])[1][-1]
        for part in (slice(0, 2), slice(2, 6))
    ]
    joined = join(*halves)
    for name in whole[-1]._fields:
        np.testing.assert_array_equal(getattr(whole[-1], name)[order], getattr(mixed[-1], name))
        np.testing.assert_array_equal(getattr(whole[-1], name), getattr(joined, name))
